"""Errors of the app: each is shown on the page, and the app goes on."""

import logging
from collections.abc import Callable
from functools import wraps
from typing import Any

from voxgran._base.errors import VoxgranError
from voxgran._base.guarded import reason_of

log = logging.getLogger(__name__)


class Failures:
    """Where the errors of a page go: into ``error`` of its state."""

    def __init__(self, state: Any) -> None:
        self.state = state

    def caught(self, call: Callable[..., Any]) -> Callable[..., None]:
        """Return a function that shows each error of another one, and returns nothing."""

        @wraps(call)
        def caught(*given: Any, **more: Any) -> None:
            try:
                call(*given, **more)
            except Exception as error:  # noqa: BLE001  (it is shown)
                self.tell(error)

        return caught

    def tell(self, error: Exception) -> None:
        """Show an error; one that is not of voxgran also goes to the log, once."""
        text = str(error) if isinstance(error, VoxgranError) else f"this failed ({reason_of(error)}): try again"
        if text != self.state.error and not isinstance(error, VoxgranError):
            log.error("the app goes on after an error", exc_info=error)
        self.state.error = text
