"""Entry of the command line: what a command raises becomes one line on the error stream and an exit status.

2 is bad input, 1 failure, 129, 130 and 143 an interrupt.
"""

import argparse
import errno
import io
import logging
import os
import shlex
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path

from voxgran._base.errors import Interrupted, OutputError, VoxgranError
from voxgran._base.stopping import Signals, heed
from voxgran.cli.commands import COMMANDS
from voxgran.cli.parser import name_flags, parse
from voxgran.cli.terminal import complain, warn


def run(arguments: Sequence[str] | None, signals: Signals) -> int:
    """Run a command and return the exit status: 0, 2 for bad input, 1 for failure, 129, 130 and 143 if interrupted.

    Parameters
    ----------
    arguments : sequence of str or None
        The words after the name of the program; None: those of this process.
    signals : Signals
        What notes signals meanwhile.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    if isinstance(sys.stdout, io.TextIOWrapper):
        # as on the error stream: names of files need not be text, and a terminal may know ASCII only
        sys.stdout.reconfigure(errors="backslashreplace")
    with warnings.catch_warnings():
        warnings.showwarning = warn  # type: ignore[assignment]
        try:
            return _run(words, signals)
        finally:
            _drop_unwritten()


def _run(words: list[str], signals: Signals) -> int:
    """Run a command; what it raises becomes a line and an exit status."""
    options = argparse.Namespace()
    try:
        try:
            options = parse(words, COMMANDS)
            if options.verbose:
                logging.basicConfig(stream=sys.stderr, level=logging.INFO, format="%(name)s: %(message)s")
            warnings.showwarning = lambda message, *_: warn(name_flags(str(message), options))
            heed()
            return int(COMMANDS[options.command][1](options) or 0)
        finally:
            # what has ended is not stopped any more
            signals.ends()
            if sys.stdout is not None:
                sys.stdout.flush()
    except Interrupted as stop:
        complain(f"{stop}")
        _say_how_to_go_on(options, words)
        return stop.exit_code
    except KeyboardInterrupt:
        complain("stopped")
        _say_how_to_go_on(options, words)
        return 130
    except VoxgranError as error:
        complain(name_flags(str(error), options))
        if isinstance(error, OutputError):
            _say_how_to_go_on(options, words)
        return error.exit_code
    except Warning as warning:
        complain(f"warning: {name_flags(str(warning), options)}; it ends the command, as PYTHONWARNINGS or -W asks")
        return 1
    except BrokenPipeError:
        # whoever read the output has gone: there is nobody to tell
        return 0
    except OSError as error:
        if error.errno == errno.ENOMEM:
            raise MemoryError from error
        complain(f"the output cannot be written ({error.strerror or error}): free space or choose another place")
        return OutputError.exit_code


def _drop_unwritten() -> None:
    """Drop what the streams did not take, which Python would try to write once more at its end, and fail."""
    for stream in (sys.stdout, sys.stderr):
        try:
            if stream is not None:
                stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _say_how_to_go_on(options: argparse.Namespace, words: Sequence[str]) -> None:
    """Name the command that goes on, where one has left a state to go on from."""
    command = getattr(options, "command", "")
    if command in ("settle", "compress"):
        from voxgran.cli.settling import checkpoint_of

        if checkpoint_of(options).exists():
            complain(f"to go on: voxgran {_resumed(words)}")
    if command == "relax":
        from voxgran.cli import decks

        state = decks.checkpoint_of(options)
        if state.exists():
            kept = [str(state) if word == options.file else word for word in words]
            complain(f"to go on from the last state: voxgran {shlex.join(kept)}")
    # what is finished is found again, and nothing is lost where nothing is
    if command == "study" and not options.dry_run:
        complain(f"to go on: voxgran {shlex.join(word for word in words if word != '--overwrite')}")
    if command not in ("run", "twin"):
        return
    from voxgran.scene.run import CHECKPOINT, SUMMARY

    left = (CHECKPOINT, f"seed_*/{CHECKPOINT}", f"seed_*/{SUMMARY}")
    if any(next(Path(options.output).glob(name), None) for name in left):
        complain(f"to go on: voxgran {_resumed(words)}")


def _resumed(words: Sequence[str]) -> str:
    """Return the command that goes on."""
    kept = [word for word in words if word != "--overwrite"]
    return shlex.join(kept if "--resume" in kept else [*kept, "--resume"])
