from pathlib import Path

import pytest
import torch
from smal_pickles import python2_pickle, random_content

from animal3dbox.cli.main import main
from animal3dbox.smal.files.model_files import load_model


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert isinstance(caught.value.code, int)
    return caught.value.code


def test_a_pickle_is_converted_and_loads_the_same(tmp_path: Path) -> None:
    source, target = tmp_path / "smal.pkl", tmp_path / "smal.safetensors"
    source.write_bytes(python2_pickle(random_content(joints=3), 2))
    assert run("convert-model", str(source), str(target)) == 0
    assert torch.equal(load_model(target).v_template, load_model(source).v_template)


@pytest.mark.parametrize(
    ("content", "target", "code", "says"),
    [
        (b"cos\nsystem\n(S'true'\ntR.", "out.safetensors", 3, "smal.pkl"),
        (b"no pickle", "out.safetensors", 3, "smal.pkl"),
        (b"", "out.safetensors", 3, "smal.pkl"),
        (b"", "out.pkl", 2, "must end in .safetensors"),
    ],
)
def test_what_is_no_model_is_refused_with_its_exit_code(
    tmp_path: Path,
    content: bytes,
    target: str,
    code: int,
    says: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "smal.pkl").write_bytes(content)
    assert run("convert-model", str(tmp_path / "smal.pkl"), str(tmp_path / target)) == code
    assert says in capsys.readouterr().err
    assert not (tmp_path / target).exists()


def test_a_missing_file_is_input_that_cannot_be_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("convert-model", str(tmp_path / "none.pkl"), str(tmp_path / "out.safetensors")) == 3
    assert "none.pkl" in capsys.readouterr().err
