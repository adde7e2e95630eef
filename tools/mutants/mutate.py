"""Small faults (mutants) of a module, one at a time, that a test suite must catch.

Each mutant has a key that survives moved lines: module, function, original code and changed code. A list of
equivalent mutants therefore survives edits elsewhere in the module. Annotations, docstrings and constant
texts are not changed; an f-string becomes None.
"""

import ast
import copy
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

_COMPARE: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
_BINARY: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}
_SWAPPED = {"min": "max", "any": "all", "argmin": "argmax", "minimum": "maximum"}
_NAMES = _SWAPPED | {b: a for a, b in _SWAPPED.items()}


@dataclass(frozen=True)
class Mutant:
    """One fault: its key, its line, and a function that returns the whole module with it."""

    key: str
    line: int
    make: Callable[[], ast.Module]

    @property
    def tree(self) -> ast.Module:
        """Syntax tree of the whole module with the fault."""
        return self.make()


def mutants_of(name: str, source: str) -> list[Mutant]:
    """Return all mutants of one module, in the order of its lines.

    Args:
        name: Short name of the module, for the keys.
        source: Source text of the module.
    """
    tree = ast.parse(source)
    seen: Counter[str] = Counter()
    found = []
    for path, where in _places(tree):
        original = _at(tree, path)
        for changed in _changes(original):
            key = f"{name}:{where}: {_text(original)} -> {_text(changed)}"
            seen[key] += 1
            number = f" #{seen[key]}" if seen[key] > 1 else ""
            found.append(Mutant(key + number, original.lineno, partial(_with, tree, path, changed)))
    return found


Step = tuple[str, int | None]
Path = tuple[Step, ...]
_SKIPPED = {"annotation", "returns", "decorator_list", "type_params"}
_GUARDS = {"strict", "slots", "frozen"}
"""Arguments whose value is not changed: they only guard against mistakes in the code around them."""


def _places(tree: ast.Module) -> Iterator[tuple[Path, str]]:
    stack: list[tuple[ast.AST, Path, str]] = [(tree, (), "")]
    while stack:
        node, path, where = stack.pop()
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            where = f"{where}.{node.name}" if where else node.name
        if isinstance(node, ast.expr | ast.stmt):
            yield path, where
        if isinstance(node, ast.JoinedStr) or (isinstance(node, ast.keyword) and node.arg in _GUARDS):
            continue
        children = [
            (child, (*path, step), where) for step, child in _children(node) if step[0] not in _SKIPPED
        ]
        stack.extend(reversed(children))


def _children(node: ast.AST) -> Iterator[tuple[Step, ast.AST]]:
    for field, value in ast.iter_fields(node):
        if isinstance(value, ast.AST):
            yield (field, None), value
        elif isinstance(value, list):
            yield from (((field, i), v) for i, v in enumerate(value) if isinstance(v, ast.AST))


def _at(tree: ast.AST, path: Path) -> ast.expr | ast.stmt:
    node: ast.AST = tree
    for field, i in path:
        value = getattr(node, field)
        node = value if i is None else value[i]
    assert isinstance(node, ast.expr | ast.stmt)
    return node


def _with(tree: ast.Module, path: Path, changed: ast.AST) -> ast.Module:
    tree = copy.deepcopy(tree)
    node: ast.AST = tree
    for field, i in path[:-1]:
        value = getattr(node, field)
        node = value if i is None else value[i]
    field, i = path[-1]
    if i is None:
        setattr(node, field, changed)
    else:
        getattr(node, field)[i] = changed
    return ast.fix_missing_locations(tree)


def _text(node: ast.AST) -> str:
    return " ".join(ast.unparse(node).split())


def _changes(node: ast.expr | ast.stmt) -> Iterator[ast.AST]:
    """Yield the changed forms of one node; a node of another kind has none."""
    yield from _changed_operators(node)
    yield from _changed_values(node)
    yield from _changed_calls_and_loops(node)


def _changed_operators(node: ast.expr | ast.stmt) -> Iterator[ast.AST]:
    match node:
        case ast.Compare(ops=[op]):
            for other in _COMPARE[type(op)]:
                yield _copied(node, ops=[other()])
        case ast.BinOp(op=op) if type(op) in _BINARY and not _is_type(node):
            yield _copied(node, op=_BINARY[type(op)]())
        case ast.AugAssign(op=op, target=target, value=value) if type(op) in _BINARY:
            yield _copied(node, op=_BINARY[type(op)]())
            yield ast.copy_location(ast.Assign([target], value), node)
        case ast.BoolOp(op=op):
            yield _copied(node, op=ast.Or() if isinstance(op, ast.And) else ast.And())
        case ast.UnaryOp(op=ast.Not() | ast.USub(), operand=operand):
            yield operand
        case ast.IfExp(body=body, orelse=orelse):
            yield from (body, orelse)


def _changed_values(node: ast.expr | ast.stmt) -> Iterator[ast.AST]:
    match node:
        case ast.Constant(value=bool() as value):
            yield _copied(node, value=not value)
        case ast.Constant(value=int() | float() as value):
            yield _copied(node, value=_other(value))
        case ast.JoinedStr():
            yield ast.copy_location(ast.Constant(None), node)
        case ast.Name(id=name) | ast.Attribute(attr=name) if name in _NAMES:
            yield _copied(node, **{"id" if isinstance(node, ast.Name) else "attr": _NAMES[name]})


def _changed_calls_and_loops(node: ast.expr | ast.stmt) -> Iterator[ast.AST]:
    match node:
        case ast.Expr(value=ast.Call(func=ast.Name(id="assert_never"))):
            return  # never reached, which the type checker proves
        case ast.Expr(value=ast.Call()):
            yield ast.copy_location(ast.Pass(), node)
        case ast.Call(keywords=[*others, ast.keyword(arg="strict")]):
            yield _copied(node, keywords=others)
        case ast.Continue():
            yield ast.copy_location(ast.Break(), node)
        case ast.Break():
            yield ast.copy_location(ast.Continue(), node)


def _other(value: float) -> float:
    return value + 1 if isinstance(value, int) else (2.0 * value or 1.0)


def _is_type(node: ast.BinOp) -> bool:
    """Return True for a union of types, as in ``X = A | B``."""
    return isinstance(node.op, ast.BitOr)


def _copied(node: ast.AST, **fields: object) -> ast.AST:
    made = copy.deepcopy(node)
    for field, value in fields.items():
        setattr(made, field, value)
    return made
