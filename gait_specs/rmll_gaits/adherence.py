"""A robot's way through a gait's automaton: what the daemon does, and the judge of a log."""

from rmll_gaits import machine
from rmll_gaits.machine import Machine
from rmll_gaits.table import MachineTable


class GaitProgress:
    """One robot in one gait; the last step can be read from the attributes."""

    def __init__(self, table: MachineTable) -> None:
        self._machine = Machine.of(table)
        self._start = table.start
        self.reset()

    def reset(self) -> None:
        """Begin an episode in the start state."""
        self._age = -1
        self.state = self._start
        """State of the automaton, after the step"""
        self.phi = 0
        """Policy steps since the last transition"""
        self.advanced = False
        """An edge of the gait was taken"""
        self.off_spec = False
        """Neither an edge nor a hold of the state before the step explains the label"""

    def step(self, label: int, frequency: float) -> None:
        """Advance the automaton; the first step of an episode only looks.

        The sink is for training. On the robot a label that would lead there is off-spec, and the
        automaton waits where it is.
        """
        self.advanced = self.off_spec = False
        if self._age >= 0:
            outcome = machine.step(self._machine, self.state, self.phi, label, frequency, self._age)
            explained = machine.explained(self._machine, self.state, label)
            self.advanced = bool(outcome.advanced)
            self.off_spec = bool(outcome.rejected or not explained)
            self.phi = 0 if self.advanced else self.phi + 1
            self.state = int(outcome.state) if self.advanced else self.state
        self._age += 1
