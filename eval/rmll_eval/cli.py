"""``rmll-eval``: policies on the test bench."""

from rmll_contract import command
from rmll_eval.conformance_command import conformance
from rmll_eval.gait import gait


def main() -> None:
    command.run("rmll-eval", {"gait": gait, "conformance": conformance})


if __name__ == "__main__":
    main()
