"""Colours shared by every picture."""

FOOT_COLOURS = {"FL": "#0072b2", "FR": "#d55e00", "BL": "#009e73", "BR": "#cc79a7"}
"""Okabe and Ito's, told apart by colour-blind people too; in the paper's order of feet"""

INK = "#263238"
MUTED = "#90a4ae"
PAPER = "#ffffff"
HIGHLIGHT = "#fff3c4"
REJECT = "#c62828"

STATE_COLOURS = ("#cfd8dc", "#b3cde3", "#ccebc5", "#fed9a6", "#decbe4", "#fddaec")
"""Fills of automaton states, repeated when there are more"""


def state_colour(state: int) -> str:
    """Fill of the state with this index."""
    return STATE_COLOURS[state % len(STATE_COLOURS)]
