"""The errors that end a command with one line."""


class UsageError(ValueError):
    """An invalid argument or parameter: exit code 2. The text says what is allowed."""


class CommandError(Exception):
    """A failure: exit code 1. The text gives the reason, and perhaps a remedy."""
