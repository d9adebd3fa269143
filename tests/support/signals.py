"""What processes that tests start do with signals."""

import signal


def let_children_have_defaults() -> None:
    """Let started processes react to SIGINT and SIGHUP even if this one was told to ignore them.

    A shell lets what it starts in the background (`make test &`) ignore SIGINT, and `nohup` SIGHUP.
    Ignored signals are inherited; those that a process handles are not. This process goes on
    ignoring them.
    """
    for number in (signal.SIGINT, signal.SIGHUP):
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, lambda *_: None)
