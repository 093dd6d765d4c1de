"""Which file --policy means."""

from pathlib import Path

import pytest

from rmll_common.errors import InputError
from rmll_onboard.control import shipped_policies
from rmll_onboard.control.shipped_policies import find_policy

SHIPPED = Path(__file__).parents[2] / "policies"


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def put(*names: str) -> None:
    for name in names:
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).touch()


def test_a_name_is_the_shipped_bundle_wherever_one_is(capsys) -> None:
    assert find_policy(Path("trot")) == SHIPPED / "trot.onnx"
    assert capsys.readouterr().err == ""


def test_a_folder_of_bundles_here_comes_first() -> None:
    put("policies/trot.onnx", "policies/canter.onnx")
    assert find_policy(Path("trot")) == Path("policies/trot.onnx")
    assert find_policy(Path("canter")) == Path("policies/canter.onnx")
    assert find_policy(Path("walk")) == SHIPPED / "walk.onnx"


@pytest.mark.parametrize("path", ["trot.onnx", "./no/trot", "policies/walk.onnx", "/nowhere.onnx"])
def test_a_path_is_that_file(path: str) -> None:
    assert find_policy(Path(path)) == Path(path)


def test_a_file_of_the_same_name_is_passed_over_and_told(capsys) -> None:
    put("trot.onnx")
    assert find_policy(Path("trot")) == SHIPPED / "trot.onnx"
    assert capsys.readouterr().err == (
        f"--policy trot is {SHIPPED / 'trot.onnx'}; the one in this folder is --policy trot.onnx\n"
    )
    assert find_policy(Path("trot.onnx")) == Path("trot.onnx")


def test_a_bundle_without_a_suffix_stays_a_file() -> None:
    put("mine")
    assert find_policy(Path("mine")) == Path("mine")


def test_what_is_not_there_is_told_with_what_is(monkeypatch) -> None:
    with pytest.raises(InputError, match=r"no policies/gallop\.onnx; there is: bound, half_bound"):
        find_policy(Path("gallop"))
    # an installed wheel has none
    monkeypatch.setattr(shipped_policies, "_CHECKOUT", Path("nowhere"))
    put("gallop.onnx")
    with pytest.raises(InputError) as error:
        find_policy(Path("gallop"))
    told = "no policies/gallop.onnx; there is: none; in this folder: gallop.onnx"
    assert str(error.value) == f"--policy gallop: {told}"
