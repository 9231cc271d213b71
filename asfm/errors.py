"""Exception for faults of the input, the configuration or the command line."""


class AsfmError(Exception):
    """An input, a configuration or a command line is at fault.

    The message is one line: what was expected, what was found, where, and what to do. The command line prints it
    and exits with code 2; every other exception is a defect of asfm.
    """
