"""The two ways a command ends badly."""


class InputError(ValueError):
    """The user's input is wrong: a file, a name, a flag. Commands exit with 2.

    The message is one line: which file, where, what was found, what was expected.
    """


class Failure(RuntimeError):
    """The input was fine and the work failed. Commands exit with 1."""
