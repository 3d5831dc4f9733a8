"""The exit codes of every command, so that a script can tell what happened."""

from enum import IntEnum


class ExitCode(IntEnum):
    """How a command ended.

    Attributes:
        OK: every sample was read; each animal has a label, or a reason in the report.
        USAGE: an option is wrong, or two contradict each other; tyro uses the same code.
        INPUT: the input cannot be found, or cannot be read as a whole.
        FAULTY: done, but some samples were faulty and are listed; of `doctor`, something is broken.
        OUTPUT: the results could not be written, or not all of them.
        INTERRUPTED: the user stopped it (Ctrl-C); as shells write it.
        CLOSED_PIPE: nobody reads what is printed any more, as after `| head`; as shells write it.
    """

    OK = 0
    USAGE = 2
    INPUT = 3
    FAULTY = 4
    OUTPUT = 5
    INTERRUPTED = 130
    CLOSED_PIPE = 141
