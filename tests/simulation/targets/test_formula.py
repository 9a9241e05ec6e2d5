import math

import numpy as np
import pytest

from labctl.errors import BadInput
from labctl.simulation.targets.formula import DEEPEST, FUNCTIONS, LONGEST, parse_formula

X_MM, Y_MM = np.array([3.0, -6.0, 0.5]), np.array([4.0, 8.0, -0.25])


@pytest.mark.parametrize(
    ("text", "by_hand"),
    [
        ("x", lambda x, y: x),
        ("0.01*(x**2 - y**2)", lambda x, y: 0.01 * (x**2 - y**2)),
        ("(x**3 - 3*x*y**2) / 2.5e3", lambda x, y: (x**3 - 3 * x * y**2) / 2500),
        (" -r + +2 ", lambda x, y: 2 - math.hypot(x, y)),
        ("10*cos(pi*x/140)", lambda x, y: 10 * math.cos(math.pi * x / 140)),
        ("max(min(x, 1), -1)", lambda x, y: max(min(x, 1), -1)),
        ("atan2(y, x) - hypot(x, y)", lambda x, y: math.atan2(y, x) - math.hypot(x, y)),
        ("7", lambda x, y: 7.0),
        ("2 - 3 - x", lambda x, y: -1 - x),
        ("2**3**2", lambda x, y: 512.0),
    ],
)
def test_it_is_what_one_works_out_by_hand(text, by_hand):
    expected = [by_hand(x, y) for x, y in zip(X_MM.tolist(), Y_MM.tolist(), strict=True)]
    np.testing.assert_allclose(parse_formula(text).z_mm(X_MM, Y_MM), expected)


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_every_function_is_the_one_of_its_name(name):
    count, _ = FUNCTIONS[name]
    by_hand = {"abs": abs, "min": min, "max": max}.get(name) or getattr(math, name)
    z_mm = parse_formula(f"{name}(0.3)" if count == 1 else f"{name}(0.3, 0.2)").z_mm(X_MM, Y_MM)
    np.testing.assert_allclose(z_mm, by_hand(*(0.3, 0.2)[:count]))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("__import__('os').system('true')", "is not allowed"),
        ("x.real", "'x.real' is not allowed"),
        ("foo(x)", "the function 'foo' is not allowed"),
        ("z", "the name 'z' is not allowed"),
        ("e", "the name 'e' is not allowed"),
        ("x^2", "a power is **"),
        ("x//2", "is not allowed"),
        ("1j*x", "'1j' is not allowed"),
        ("True", "'True' is not allowed"),
        ("'x'*9", "is not allowed"),
        ("x if y else r", "is not allowed"),
        ("[x for x in y]", "is not allowed"),
        ("(x, y)", "is not allowed"),
        ("lambda: x", "is not allowed"),
        ("x < y", "is not allowed"),
        ("sin(*x)", "is not allowed"),
        ("sin(x=x)", "is not allowed"),
        ("sin(x, y)", "sin takes 1, not 2"),
        ("max(x)", "max takes 2, not 1"),
        ("1if x else 2", "is not allowed"),
        ("2x", "no arithmetic expression"),
        ("x = 3", "no arithmetic expression"),
        ("", "no arithmetic expression"),
        ("x\x00", "no arithmetic expression"),
        ("(" * 250 + "x", "no arithmetic expression"),
        ("-" * DEEPEST + "x", "nested more than 60 deep"),
        ("x" + "+x" * LONGEST, "the limit is 300"),
        ("1e400", "beyond what a float holds"),
        ("0x" + "f" * 290, "beyond what a float holds"),
    ],
)
def test_anything_but_arithmetic_is_refused_by_name(text, words):
    with pytest.raises(BadInput) as refused:
        parse_formula(text)
    assert words in str(refused.value)


@pytest.mark.parametrize("text", ["9**9**9**9", "10**400", "1/(x - 3)", "sqrt(0 - r)", "exp(exp(9*r))"])
def test_what_has_no_value_is_not_finite_at_once(text):
    assert not np.isfinite(parse_formula(text).z_mm(X_MM, Y_MM)).all()
