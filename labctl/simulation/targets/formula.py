"""z = f(x, y) as text: read through Python's syntax tree, of which only arithmetic is let through."""

import ast
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labctl.errors import BadInput

Floats = NDArray[np.float64]
LONGEST = 300
DEEPEST = 60
VARIABLES = ("x", "y", "r")
_OPERATORS: Mapping[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Pow: np.power,
}
_SIGNS: Mapping[type[ast.unaryop], Callable[[Any], Any]] = {ast.UAdd: np.positive, ast.USub: np.negative}
# How many arguments, and what works it out; angles in radians.
FUNCTIONS: Mapping[str, tuple[int, Callable[..., Any]]] = {
    "sqrt": (1, np.sqrt),
    "abs": (1, np.abs),
    "exp": (1, np.exp),
    "log": (1, np.log),
    "sin": (1, np.sin),
    "cos": (1, np.cos),
    "tan": (1, np.tan),
    "asin": (1, np.arcsin),
    "acos": (1, np.arccos),
    "atan": (1, np.arctan),
    "atan2": (2, np.arctan2),
    "sinh": (1, np.sinh),
    "cosh": (1, np.cosh),
    "tanh": (1, np.tanh),
    "hypot": (2, np.hypot),
    "min": (2, np.minimum),
    "max": (2, np.maximum),
}
_ALLOWED = f"x, y, r, pi, numbers, + - * / **, brackets and {', '.join(FUNCTIONS)}"


@dataclass(frozen=True)
class Formula:
    """A height z over x and y, all in mm, x and y from the sheet's centre along the sheet frame's axes."""

    text: str
    tree: ast.expr

    def z_mm(self, x_mm: Floats, y_mm: Floats) -> Floats:
        """The heights (n,) at places x, y (n,); not finite where the formula has no value, or too large a one."""
        values = {"x": x_mm, "y": y_mm, "r": np.hypot(x_mm, y_mm), "pi": np.float64(np.pi)}
        with np.errstate(all="ignore"):
            return np.broadcast_to(_value(self.tree, values), x_mm.shape)


def parse_formula(text: str) -> Formula:
    """The formula in a text such as "0.01*(x**2 - y**2)".

    Nothing but arithmetic on x, y, r (the distance from the centre), pi, numbers and the functions of
    `FUNCTIONS` is let through; all of it is worked out in float64, so no power grows without bound.

    Raises:
        BadInput: the text is longer than 300 characters, not an expression, nested deeper than 60, or has
            something else in it, which is named.
    """
    text = text.strip()
    if len(text) > LONGEST:
        raise BadInput(f"the equation has {len(text)} characters, the limit is {LONGEST}: shorten it")
    try:
        with warnings.catch_warnings():
            # Python warns of an odd literal; the check below has the better message.
            warnings.simplefilter("ignore")
            tree = ast.parse(text, mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError) as error:
        what = error.msg if isinstance(error, SyntaxError) else str(error)
        raise BadInput(f"{text!r} is no arithmetic expression ({what}): use {_ALLOWED}") from None
    _check(tree, text, depth=1)
    return Formula(text, tree)


def _check(node: ast.expr, text: str, depth: int) -> None:
    if depth > DEEPEST:
        raise BadInput(f"{text!r} is nested more than {DEEPEST} deep: simplify it")
    for part in _parts(node, text):
        _check(part, text, depth + 1)


def _parts(node: ast.expr, text: str) -> list[ast.expr]:
    """The operands of one step of the formula, if it is a step that is let through."""
    match node:
        case ast.BinOp(left, operator, right) if type(operator) in _OPERATORS:
            return [left, right]
        case ast.UnaryOp(sign, operand) if type(sign) in _SIGNS:
            return [operand]
        case ast.Name(name) if name in (*VARIABLES, "pi"):
            return []
        case ast.Constant(int() | float() as value) if not isinstance(value, bool):
            _check_number(value, text)
            return []
        case ast.Call(ast.Name(name), arguments, []) if name in FUNCTIONS:
            _check_count(name, arguments, text)
            return arguments
    raise BadInput(f"{text!r}: {_described(node, text)} is not allowed: use {_ALLOWED}")


def _check_number(value: float, text: str) -> None:
    # An integer of Python's can be too long for a float.
    if not abs(value) <= float(np.finfo(np.float64).max):
        raise BadInput(f"{text!r}: a number in it is beyond what a float holds: use lengths in mm")


def _check_count(name: str, arguments: list[ast.expr], text: str) -> None:
    wanted, _ = FUNCTIONS[name]
    if len(arguments) != wanted:
        raise BadInput(f"{text!r}: {name} takes {wanted}, not {len(arguments)}")


def _described(node: ast.expr, text: str) -> str:
    match node:
        case ast.BinOp(_, ast.BitXor(), _):
            return "^ (a power is **)"
        case ast.Call(ast.Name(name)) if name not in FUNCTIONS:
            return f"the function {name!r}"
        case ast.Name(name):
            return f"the name {name!r}"
    return repr(ast.get_source_segment(text, node))


def _value(node: ast.expr, values: Mapping[str, Any]) -> Any:  # noqa: ANN401 - an array, or one float64
    match node:
        case ast.BinOp(left, operator, right):
            return _OPERATORS[type(operator)](_value(left, values), _value(right, values))
        case ast.UnaryOp(sign, operand):
            return _SIGNS[type(sign)](_value(operand, values))
        case ast.Name(name):
            return values[name]
        case ast.Call(ast.Name(name), arguments):
            return FUNCTIONS[name][1](*(_value(argument, values) for argument in arguments))
        case ast.Constant(int() | float() as value):
            return np.float64(value)
    raise AssertionError(f"{ast.dump(node)} was let through")
