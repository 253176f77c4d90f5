"""The one exception that means: the input is wrong, and here is what to do."""


class InputError(Exception):
    """The user's input cannot be used.

    The message is a single sentence or two that name the file, key or row, say what was found and
    what is accepted. The command line prints it and exits with code 2; nothing half-written is left.
    """
