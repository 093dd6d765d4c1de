"""Numbers on the command line, and that every command refuses those that make no sense."""

import math
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from rmll_common.errors import InputError
from rmll_common.flag import within
from rmll_eval import cli as evaluate
from rmll_hil import cli as hil
from rmll_onboard import cli as onboard
from rmll_view import gait_cli

TROT = str(Path(__file__).parents[2] / "policies" / "trot.onnx")
WALK = ("run", "--policy", TROT, "--lockstep", "--out", "/nowhere/x")
NUMBERS = [
    (gait_cli.main, ("check", "trot"), "frequency", (0, "nan", "inf", "1e9")),
    (gait_cli.main, ("show", "trot"), "frequency", (-1, "nan", "inf")),
    (onboard.main, ("--policy", TROT), "vx", ("nan", "inf", 1e9)),
    (onboard.main, ("--policy", TROT), "wz", ("nan", "-inf", 1e9)),
    (onboard.main, ("--policy", TROT), "frequency", (-1, "nan", "inf")),
    (onboard.main, ("--policy", TROT, "--vx", "0"), "seconds", (-1, 0, "nan", "inf", 1e300)),
    *((hil.main, WALK, name, (-9, "nan", "inf")) for name in ("vx", "wz", "frequency", "friction")),
    (hil.main, WALK, "seconds", (-1, 0, "nan", "inf", 1e300)),
    *((hil.main, WALK, name, (-1, 10**12)) for name in ("action-delay-ms", "command-timeout-ms")),
    (hil.main, WALK, "level", (-1, 10)),
    (hil.main, WALK, "seed", (-1,)),
    (hil.main, ("serve", "--port", "0"), "seed", (-1,)),
    (hil.main, ("serve", "--port", "0"), "friction", ("nan", "inf", 0)),
    (hil.main, ("faults", "--policy", TROT), "jobs", (-1, 0, 10**6)),
    *((evaluate.main, ("gait", TROT), name, (-1, 0, 10**9)) for name in ("repeats", "jobs")),
    (evaluate.main, ("gait", TROT), "episodes", (-1, 0, 10**12)),
    (evaluate.main, ("gait", TROT), "seconds", (-1, 0, "nan", "inf", 1e300)),
    (evaluate.main, ("gait", TROT), "seed", (-1, 10**30)),
    (evaluate.main, ("gait", TROT), "level", (-1, 10)),
    *((evaluate.main, ("gait", TROT), name, ("nan", "inf", -9))
      for name in ("speeds", "frequencies")),
]  # fmt: skip
ONE_BY_ONE = [(main, words, name, str(value)) for main, words, name, values in NUMBERS
              for value in values]  # fmt: skip


@pytest.mark.parametrize(
    ("main", "words", "name", "value"),
    ONE_BY_ONE,
    ids=lambda part: part.__module__ if callable(part) else str(part)[-20:],
)
def test_a_senseless_number_is_refused_in_one_line_that_names_the_flag(
    main: Callable[[], None], words: tuple[str, ...], name: str, value: str,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.setattr(sys, "argv", ["rmll", *words, f"--{name}", value])
    with pytest.raises(SystemExit) as end:
        main()
    out, err = capsys.readouterr()
    assert (end.value.code, out, err.count("\n")) == (2, "", 1), err
    assert f": --{name} " in err
    assert "expected" in err or "was trained for" in err


@pytest.mark.parametrize(
    ("value", "low", "high", "words"),
    [
        (-1, 0, math.inf, "--n -1: expected at least 0"),
        (math.nan, 0, math.inf, "--n nan: expected at least 0"),
        (10**400, 1, 5, f"--n {10**400}: expected 1 to 5"),
        (0.5, 1.0, 1e6, "--n 0.5: expected 1 to 1000000"),
    ],
)
def test_what_is_found_and_what_is_expected_is_told(value, low, high, words) -> None:
    with pytest.raises(InputError) as error:
        within("n", value, low, high)
    assert str(error.value) == words


def test_both_ends_are_fine() -> None:
    within("n", 1, 1, 5)
    within("n", 5.0, 1, 5)
