"""The species: their tables, and how the template and the master are mixed from them."""

from animal3dbox.smal.quadruped.modelling.species_bear import BEAR
from animal3dbox.smal.quadruped.modelling.species_cat import CAT
from animal3dbox.smal.quadruped.modelling.species_cow import COW
from animal3dbox.smal.quadruped.modelling.species_deer import DEER
from animal3dbox.smal.quadruped.modelling.species_dog import DOG
from animal3dbox.smal.quadruped.modelling.species_hippo import HIPPO
from animal3dbox.smal.quadruped.modelling.species_horse import HORSE
from animal3dbox.smal.quadruped.modelling.species_lion import LION
from animal3dbox.smal.quadruped.modelling.species_pig import PIG
from animal3dbox.smal.quadruped.modelling.species_zebra import ZEBRA

SPECIES = {
    "dog": DOG, "cat": CAT, "horse": HORSE, "cow": COW, "bear": BEAR, "deer": DEER, "zebra": ZEBRA,
    "pig": PIG, "hippo": HIPPO, "lion": LION,
}  # fmt: skip
TEMPLATE_SHARES = {"dog": 0.45, "cat": 0.15, "horse": 0.25, "cow": 0.15}
MASTER_SHARES = {"dog": 0.3, "cat": 0.3, "horse": 0.1, "cow": 0.3}
