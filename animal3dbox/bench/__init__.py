"""A benchmark of monocular 3D animal detection: made from a seed file, verified, and scored.

docs/bench.md has its rules. The names below are loaded when first used (PEP 562).
"""

from typing import TYPE_CHECKING

from animal3dbox.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from animal3dbox.bench.baselines import run_baseline as run_baseline
    from animal3dbox.bench.image_rows import pixel_digest as pixel_digest
    from animal3dbox.bench.make import make_bench as make_bench
    from animal3dbox.bench.manifest import Manifest as Manifest
    from animal3dbox.bench.manifest import read_manifest as read_manifest
    from animal3dbox.bench.plan import BenchPlan as BenchPlan
    from animal3dbox.bench.plan import SplitPlan as SplitPlan
    from animal3dbox.bench.plan import bench_plan as bench_plan
    from animal3dbox.bench.results import ResultHead as ResultHead
    from animal3dbox.bench.results import write_head as write_head
    from animal3dbox.bench.score import SplitScore as SplitScore
    from animal3dbox.bench.score import score_result as score_result
    from animal3dbox.bench.score import score_tables as score_tables
    from animal3dbox.bench.verify import BenchFindings as BenchFindings
    from animal3dbox.bench.verify import verify_bench as verify_bench

__getattr__, __dir__, __all__ = lazy_exports(
    __name__,
    {
        "baselines": ("run_baseline",),
        "image_rows": ("pixel_digest",),
        "make": ("make_bench",),
        "manifest": ("Manifest", "read_manifest"),
        "plan": ("BenchPlan", "SplitPlan", "bench_plan"),
        "results": ("ResultHead", "write_head"),
        "score": ("SplitScore", "score_result", "score_tables"),
        "verify": ("BenchFindings", "verify_bench"),
    },
)
