"""The vocabulary that docs/formats.md shows can be read."""

import re
from pathlib import Path

from animal3dbox.smal.keypoints.vocabulary import load_vocabulary


def test_the_documented_vocabulary_is_read(tmp_path: Path) -> None:
    page = (Path(__file__).parent.parent / "docs" / "formats.md").read_text()
    found = re.search(r"```toml\n(.*?)```", page, re.DOTALL)
    assert found is not None
    (tmp_path / "mine.toml").write_text(found[1])
    assert load_vocabulary(tmp_path / "mine.toml").flip == (0, 2, 1, 4, 3, 5)
