"""How well a policy keeps its gait, over the commands it was trained for."""
