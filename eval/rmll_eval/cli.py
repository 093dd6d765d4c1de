"""``rmll-eval``: policies on the test bench."""

from rmll_common import command_line
from rmll_eval.conformance_command import conformance
from rmll_eval.gait_command import gait


def main() -> None:
    command_line.run("rmll-eval", {"gait": gait, "conformance": conformance})


if __name__ == "__main__":
    main()
