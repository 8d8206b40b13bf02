"""Codes of findings and refusals as they stand in source: read from its tree, without running it."""

import ast
import re
from collections.abc import Iterator
from typing import NamedTuple

KINDS = {
    "Diagnostic": ("code", "severity", "message", "advice"),
    "DegenerateGeometryError": ("message", "code"),
}
CODE = re.compile(r"[a-z]+(-[a-z0-9]+)+")
# Of `NearDegeneracy`: a refusal takes the code of the configuration that is near.
NEAR_CODES = {"parallel-lines", "lines-through-one-point", "coplanar-lines", "collinear-image-points"}


class Made(NamedTuple):
    """One place that makes a finding or a refusal.

    Attributes:
        kind: the class.
        codes: that it can have; a hole in a code is ``*``.
        message: the parts of its message that are always the same.
        ends: how its message and its advice end, where that is always the same.
        line: in its file.
    """

    kind: str
    codes: frozenset[str]
    message: tuple[str, ...]
    ends: tuple[str, ...]
    line: int


def made_in(source: str) -> Iterator[Made]:
    """Every call of the classes, and of functions of the same file that pass a code on to one."""
    tree = ast.parse(source)
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
        kind = name_of(call)
        if kind not in KINDS:
            continue
        given = arguments(call, KINDS[kind])
        through = passing_on(functions, given["code"])
        if through is None:
            yield made(kind, given, call, tree)
            continue
        names = tuple(one.arg for one in through.args.args)
        for other in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
            if name_of(other) == through.name:
                yield made(kind, arguments(other, names), other, tree)


def made(kind: str, given: dict[str, ast.expr], call: ast.Call, tree: ast.Module) -> Made:
    message = given.get("message")
    ends = tuple(end for name in ("message", "advice") if (end := fixed_end(given.get(name))))
    return Made(kind, frozenset(codes_of(given["code"], tree)), fixed_parts(message), ends, call.lineno)


def name_of(call: ast.Call) -> str:
    return call.func.id if isinstance(call.func, ast.Name) else ""


def arguments(call: ast.Call, names: tuple[str, ...]) -> dict[str, ast.expr]:
    named = {keyword.arg: keyword.value for keyword in call.keywords if keyword.arg}
    return dict(zip(names, call.args, strict=False)) | named


def passing_on(functions: list[ast.FunctionDef], code: ast.expr) -> ast.FunctionDef | None:
    """The function that has the code as a parameter, if one has."""
    for function in functions:
        inside = any(node is code for node in ast.walk(function))
        if inside and isinstance(code, ast.Name) and code.id in [one.arg for one in function.args.args]:
            return function
    return None


def codes_of(code: ast.expr, tree: ast.Module) -> set[str]:
    """What an expression can come to: text, either side of an if, text with holes, or keys of a dictionary."""
    if isinstance(code, ast.Constant):
        return {code.value}
    if isinstance(code, ast.IfExp):
        return codes_of(code.body, tree) | codes_of(code.orelse, tree)
    if isinstance(code, ast.JoinedStr):
        return {"".join(p.value if isinstance(p, ast.Constant) else "*" for p in code.values)}
    if isinstance(code, ast.Name):
        keys = [key for node in ast.walk(tree) if isinstance(node, ast.Dict) for key in node.keys]
        keys += [node.slice for node in ast.walk(tree) if isinstance(node, ast.Subscript)]
        texts = {key.value for key in keys if isinstance(key, ast.Constant) and isinstance(key.value, str)}
        return {text for text in texts if CODE.fullmatch(text)}
    if (
        isinstance(code, ast.Attribute) and code.attr == "code"
    ):  # what a maker of such an object, in any file, gave
        return set(NEAR_CODES)
    raise AssertionError(f"line {code.lineno}: {ast.unparse(code)} is no code that can be read from source")


def fixed_parts(message: ast.expr | None) -> tuple[str, ...]:
    if isinstance(message, ast.Constant):
        return (message.value,)
    if not isinstance(message, ast.JoinedStr):
        return ()
    parts = [part.value for part in message.values if isinstance(part, ast.Constant)]
    return tuple(" ".join(part.split()) for part in parts if part.strip())


def fixed_end(text: ast.expr | None) -> str:
    """The last letters of a text; none where they depend on something."""
    last = text.values[-1] if isinstance(text, ast.JoinedStr) and text.values else text
    return str(last.value)[-3:] if isinstance(last, ast.Constant) else ""
