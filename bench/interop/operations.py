"""How each operation of a client went, as a JSON line; runs in the client's environment, on the standard library."""

import asyncio
import json
from collections.abc import Callable
from typing import Any


class Operations:
    """Runs operations one by one; none of them ends the next."""

    def run(
        self, name: str, operate: Callable[[], Any], is_right: Callable[[Any], bool] = lambda _: True
    ) -> Any:  # noqa: ANN401 - whatever the client returns
        """Run `operate` and print how it went; returns its value, None where it raised.

        A coroutine is waited for. `is_right` judges the value.
        """
        try:
            value = operate()
            if asyncio.iscoroutine(value):
                value = asyncio.get_event_loop().run_until_complete(value)
        except Exception as error:  # whatever a client raises is a result here
            self._print(name, "refused", f"{type(error).__name__}: {error}")
            return None
        self._print(name, "works" if is_right(value) else "wrong", _short(value))
        return value

    def refused(self, name: str, operate: Callable[[], Any], by: type[Exception] = Exception) -> None:
        """Run what the device has not: works where the client is told so, by an error of that type."""
        try:
            value = operate()
            if asyncio.iscoroutine(value):
                value = asyncio.get_event_loop().run_until_complete(value)
        except Exception as error:  # whatever a client raises is a result here
            result = "refused rightly" if isinstance(error, by) else "wrong"
            self._print(name, result, f"{type(error).__name__}: {error}")
            return
        self._print(name, "wrong", f"not refused: {_short(value)}")

    def _print(self, operation: str, result: str, detail: str) -> None:
        line = {"operation": operation, "result": result, "detail": " ".join(detail.split())}
        print(json.dumps(line), flush=True)


def near(expected: float, tolerance: float = 0.02) -> Callable[[Any], bool]:
    """Whether a value is a number near `expected`."""
    return lambda value: abs(float(value) - expected) <= tolerance


def _short(value: Any) -> str:  # noqa: ANN401 - whatever the client returns
    text = "" if value is None else str(value)
    return type(value).__name__ if " object at 0x" in text else text
