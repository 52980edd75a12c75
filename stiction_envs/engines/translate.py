"""Warp kernels made from functions that numba compiles: one source for what both compute.

    @compiled def f(a, …): for i in range(len(a)): …   ->   kernel f, one thread for each i

A function is read as text and written again with Warp's words for the same arithmetic, in float64:
nothing is rounded elsewhere than on the host, but that a processor may fuse a product and a sum.
What it may contain is what the compiled functions contain that are launched so: arithmetic, loops,
arrays and their rows, tuples of arrays, local arrays of a fixed size, and calls of such functions.
"""

from __future__ import annotations

import ast
import copy
import inspect
import linecache
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from itertools import count
from types import FunctionType
from typing import Any, TypeAlias

import numpy as np
import warp as wp

Compiled = Any  # by numba, whose functions look like those that they are made from
FLOAT, INT, BOOL = wp.float64, wp.int32, wp.bool
_NUMPY = {"arctan2": "atan2"}
"""Names that Warp spells in another way."""


@dataclass(frozen=True)
class Kind:
    """Type of a scalar (no dimensions) or an array, and the sizes of its dimensions but the
    first, where they are known."""

    dtype: type
    ndim: int = 0
    sizes: tuple[int, ...] = ()

    @property
    def annotation(self) -> type | wp.array:
        """Return what a Warp function calls it."""
        return wp.array(dtype=self.dtype, ndim=self.ndim) if self.ndim else self.dtype


Tree: TypeAlias = "Kind | tuple[Tree, ...]"
"""Of an argument: tuples as they are."""


def kind_of(value: object) -> Tree:
    """Return the kind of an argument of a compiled function."""
    if isinstance(value, tuple):
        return tuple(kind_of(x) for x in value)
    if isinstance(value, np.ndarray):
        dtype = {"f": FLOAT, "i": INT, "b": BOOL}[value.dtype.kind]
        return Kind(dtype, value.ndim, value.shape[1:])
    return Kind(BOOL if isinstance(value, bool) else INT if isinstance(value, int) else FLOAT)


@wp.func
def _square(x: wp.float64) -> wp.float64:
    return x * x


@wp.func
def _copysign(size: wp.float64, sign: wp.float64) -> wp.float64:
    return wp.where(sign < wp.float64(0.0), -wp.abs(size), wp.abs(size))


def kernel_of(function: Compiled, kinds: Sequence[Tree]) -> wp.Kernel:
    """Return the Warp kernel of a compiled function of N arms, launched with ``dim=N``.

    Args:
        function: its only outer loop is over its arms; it returns nothing.
        kinds: of its arguments.
    """
    made = _Translation(function, kinds, is_kernel=True).function
    options = {"max_unroll": 0, "enable_backward": False}
    return wp.kernel(made, enable_backward=False, module="unique", module_options=options)


class _Translation(ast.NodeTransformer):
    """One function with arguments of given kinds, as Warp's Python."""

    def __init__(self, function: Compiled, kinds: Sequence[Tree], is_kernel: bool) -> None:
        python: FunctionType = function.py_func
        self._known = python.__globals__
        tree = ast.parse(textwrap.dedent(inspect.getsource(python))).body[0]
        assert isinstance(tree, ast.FunctionDef)
        self._kinds: dict[str, Kind] = {}
        self._tuples: dict[str, list[str]] = {}
        self._rename: dict[str, str] = {}
        self._sizes: dict[str, int] = {}
        self._temporary = count()
        self._is_kernel, self._inside = is_kernel, 0
        self._scope: dict[str, Any] = {
            **{"__name__": python.__module__, "wp": wp},
            **{"_square": _square, "_copysign": _copysign},
        }
        names = [
            name
            for argument, kind in zip(tree.args.args, kinds, strict=True)
            for name in self._argument(argument.arg, kind)
        ]
        self._name = f"{python.__name__}_{sha256(repr(kinds).encode()).hexdigest()[:8]}"
        body = [s for s in tree.body if not _is_docstring(s)]
        tree.name, tree.decorator_list, tree.returns = self._name, [], None
        tree.args.args = [ast.arg(name) for name in names]
        tree.body = self._statements(body)
        self.function = self._defined(tree, names)

    def _argument(self, name: str, kind: Tree) -> list[str]:
        """Note an argument; return the names of its parts."""
        if isinstance(kind, Kind):
            self._kinds[name] = kind
            return [name]
        parts = [f"{name}_{k}" for k in range(len(kind))]
        self._tuples[name] = parts
        return [x for part, own in zip(parts, kind, strict=True) for x in self._argument(part, own)]

    def _defined(self, tree: ast.FunctionDef, names: list[str]) -> FunctionType:
        """Define the function, with a text that Warp can read."""
        text = ast.unparse(ast.fix_missing_locations(tree)) + "\n"
        file = f"<Warp's {self._name}>"
        linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
        exec(compile(text, file, "exec"), self._scope)
        function: FunctionType = self._scope[self._name]
        function.__annotations__ = {name: self._kinds[name].annotation for name in names}
        return function

    # ---- statements --------------------------------------------------------------------------

    def _statements(self, body: Sequence[ast.stmt]) -> list[ast.stmt]:
        out: list[ast.stmt] = []
        for statement in body:
            new = self.visit(statement)
            out += new if isinstance(new, list) else [new]
        return out

    def visit_For(self, node: ast.For) -> ast.For | list[ast.stmt]:
        if self._is_kernel and not self._inside:
            assert isinstance(node.target, ast.Name)
            self._inside = 1
            self._kinds[node.target.id] = Kind(INT)
            thread = ast.parse(f"{node.target.id} = wp.tid()").body
            return [*thread, *self._statements(node.body)]
        self._inside += 1
        assert isinstance(node.target, ast.Name)
        self._kinds[node.target.id] = Kind(INT)
        node.iter, node.body = self.visit(node.iter), self._statements(node.body)
        self._inside -= 1
        return node

    def visit_Continue(self, node: ast.Continue) -> ast.stmt:
        return ast.Return() if self._is_kernel and self._inside == 1 else node

    def visit_If(self, node: ast.If) -> ast.If:
        node.test = self.visit(node.test)
        node.body, node.orelse = self._statements(node.body), self._statements(node.orelse)
        return node

    def visit_Assign(self, node: ast.Assign) -> ast.Assign | list[ast.stmt]:
        if len(node.targets) > 1:
            first, value = node.targets[-1], node.value
            out = self._statements([ast.Assign([first], value)])
            for target in node.targets[-2::-1]:
                again = copy.deepcopy(first if _is_simple(value) is None else value)
                for part in ast.walk(again):
                    if hasattr(part, "ctx"):
                        part.ctx = ast.Load()
                out += self._statements([ast.Assign([target], again)])
            return out
        (target,) = node.targets
        if isinstance(target, ast.Tuple):
            return self._unpack(target.elts, node.value)
        return self._assign(target, node.value)

    def _assign(self, target: ast.expr, value: ast.expr) -> ast.Assign:
        """Return the assignment of one value."""
        kind = self._kind(value)
        size = self._size(value)
        if isinstance(target, ast.Name):
            self._kinds[target.id] = kind
            if size is not None:
                self._sizes[target.id] = size
        return ast.Assign([self.visit(target)], self.visit(value))

    def _unpack(self, targets: Sequence[ast.expr], value: ast.expr) -> list[ast.stmt]:
        """Return the assignments of a tuple, whose values are all taken before any is written."""
        parts = self._parts(value)
        if parts is not None:  # a tuple that was given: other names of its parts
            for target, part in zip(targets, parts, strict=True):
                assert isinstance(target, ast.Name)
                self._rename[target.id] = part
            return []
        names = [f"value_{next(self._temporary)}" for _ in targets]
        before: list[ast.stmt] = []
        if isinstance(value, ast.Tuple):
            if all(isinstance(x, ast.Name) for x in targets) and not _mixed(targets, value):
                names = [x.id for x in targets if isinstance(x, ast.Name)]
            for name, x in zip(names, value.elts, strict=True):
                before.append(self._assign(ast.Name(name, ast.Store()), x))
        else:
            called = ast.Tuple([ast.Name(x, ast.Store()) for x in names], ast.Store())
            before.append(ast.Assign([called], self.visit(value)))
            self._kinds.update((name, Kind(FLOAT)) for name in names)
        after = [
            self._assign(target, ast.Name(name, ast.Load()))
            for name, target in zip(names, targets, strict=True)
            if not (isinstance(target, ast.Name) and target.id == name)
        ]
        return [*before, *after]

    def visit_AugAssign(self, node: ast.AugAssign) -> ast.Assign:
        old = copy.deepcopy(node.target)
        for part in ast.walk(old):
            if hasattr(part, "ctx"):
                part.ctx = ast.Load()
        if isinstance(node.op, ast.BitAnd):
            return self._assign(node.target, ast.BoolOp(ast.And(), [old, node.value]))
        return self._assign(node.target, ast.BinOp(old, node.op, node.value))

    # ---- expressions -------------------------------------------------------------------------

    def visit_Constant(self, node: ast.Constant) -> ast.expr:
        return _number(node.value) if isinstance(node.value, float) else node

    def visit_Name(self, node: ast.Name) -> ast.expr:
        if node.id in self._rename:
            return ast.Name(self._rename[node.id], node.ctx)
        known = self._known.get(node.id)
        if node.id not in self._kinds and isinstance(known, float):
            return _number(float(known))
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        if _is_numpy(node):
            return _number(float(getattr(np, node.attr)))
        node.value = self.visit(node.value)
        return node

    def visit_Subscript(self, node: ast.Subscript) -> ast.expr:
        parts = self._parts(node)
        if isinstance(parts, str):
            return ast.Name(parts, ast.Load())
        node.value, node.slice = self.visit(node.value), self.visit(node.slice)
        return node

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        left = self.visit(node.left)
        if isinstance(node.op, ast.Pow):
            assert isinstance(node.right, ast.Constant)
            assert node.right.value == 2
            return _call("_square", left)
        return ast.BinOp(left, node.op, self.visit(node.right))

    def visit_Call(self, node: ast.Call) -> ast.expr:
        if isinstance(node.func, ast.Attribute):
            name = node.func.attr
            if name == "empty":
                return self._local(node)
            arguments = [self.visit(x) for x in node.args]
            if name == "copysign":
                return _call("_copysign", *arguments)
            function = ast.parse(f"wp.{_NUMPY.get(name, name)}", mode="eval").body
            return ast.Call(function, arguments, [])
        assert isinstance(node.func, ast.Name)
        name, called = node.func.id, self._known.get(node.func.id)
        if name == "len":
            return ast.parse(f"{ast.unparse(self.visit(node.args[0]))}.shape[0]", mode="eval").body
        if not hasattr(called, "py_func"):
            return ast.Call(node.func, [self.visit(x) for x in node.args], [])
        kinds = [self._tree(x) for x in node.args]
        made = _function_of(called, tuple(kinds))
        self._scope[made.key] = made
        flat = [y for x in node.args for y in self._flat(x)]
        return _call(made.key, *flat)

    def _local(self, node: ast.Call) -> ast.expr:
        """Return a local array."""
        (shape,) = node.args
        given = shape.elts if isinstance(shape, ast.Tuple) else [shape]
        sizes = tuple(self._size(x) for x in given)
        text = f"wp.zeros(shape={sizes!r}, dtype=wp.float64)"
        return ast.parse(text, mode="eval").body

    # ---- what expressions are ----------------------------------------------------------------

    def _parts(self, node: ast.expr) -> str | list[str] | None:
        """Return the names of the parts of a tuple that was given, one name where one is taken."""
        if isinstance(node, ast.Name):
            return self._tuples.get(self._rename.get(node.id, node.id))
        if isinstance(node, ast.Subscript):
            whole = self._parts(node.value)
            if isinstance(whole, list):
                return whole[eval(f"np.s_[{ast.unparse(node.slice)}]", {"np": np})]
        return None

    def _flat(self, node: ast.expr) -> list[ast.expr]:
        """Return the arguments that an expression is in a call."""
        parts = self._parts(node)
        if isinstance(parts, list):
            return [y for part in parts for y in self._flat(ast.Name(part, ast.Load()))]
        return [self.visit(copy.deepcopy(node))]

    def _tree(self, node: ast.expr) -> Tree:
        parts = self._parts(node)
        if isinstance(parts, list):
            return tuple(self._tree(ast.Name(part, ast.Load())) for part in parts)
        return self._kind(node)

    def _kind(self, node: ast.expr) -> Kind:
        """Return the kind of an expression; of all that is no name or array, a float."""
        parts = self._parts(node)
        if isinstance(parts, str):
            return self._kinds[parts]
        if isinstance(node, ast.Name):
            return self._kinds.get(self._rename.get(node.id, node.id), Kind(FLOAT))
        if isinstance(node, ast.Constant):
            plain = kind_of(node.value)
            assert isinstance(plain, Kind)
            return plain
        if isinstance(node, ast.Subscript):
            whole = self._kind(node.value)
            taken = len(node.slice.elts) if isinstance(node.slice, ast.Tuple) else 1
            return Kind(whole.dtype, max(whole.ndim - taken, 0), whole.sizes[taken:])
        if isinstance(node, ast.Call) and _is_numpy(node.func, "empty"):
            (shape,) = node.args
            return Kind(FLOAT, len(shape.elts) if isinstance(shape, ast.Tuple) else 1)
        return Kind(FLOAT)

    def _size(self, node: ast.expr) -> int | None:
        """Return a size that is known, None for another expression."""
        if isinstance(node, ast.Constant) and isinstance(node.value, int):
            return node.value
        if isinstance(node, ast.Name):
            return self._sizes.get(node.id)
        if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Attribute):
            sizes = self._kind(node.value.value).sizes
            at = node.slice.value if isinstance(node.slice, ast.Constant) else 0
            known = isinstance(at, int) and 1 <= at <= len(sizes)
            return sizes[at - 1] if known and isinstance(at, int) else None
        return None


_FUNCTIONS: dict[tuple[Compiled, tuple[Tree, ...]], wp.Function] = {}


def _function_of(function: Compiled, kinds: tuple[Tree, ...]) -> wp.Function:
    """Return the Warp function of a compiled one, the same for the same kinds."""
    at = function, kinds
    if at not in _FUNCTIONS:
        _FUNCTIONS[at] = wp.func(_Translation(function, kinds, is_kernel=False).function)
    return _FUNCTIONS[at]


def _call(name: str, *arguments: ast.expr) -> ast.Call:
    return ast.Call(ast.Name(name, ast.Load()), list(arguments), [])


def _number(value: float) -> ast.expr:
    text = f"wp.float64({value!r})" if np.isfinite(value) else f"wp.float64({_infinite(value)})"
    return ast.parse(text, mode="eval").body


def _infinite(value: float) -> str:
    return "wp.nan" if np.isnan(value) else "wp.inf" if value > 0 else "-wp.inf"


def _is_numpy(node: ast.expr, name: str = "") -> bool:
    inside = isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
    return inside and node.value.id == "np" and name in ("", node.attr)  # type: ignore[attr-defined]


def _is_docstring(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def _is_simple(node: ast.expr) -> ast.expr | None:
    return node if isinstance(node, ast.Constant) else None


def _mixed(targets: Sequence[ast.expr], value: ast.Tuple) -> bool:
    """Return whether a value is written before another is taken that depends on it."""
    written = {x.id for x in targets if isinstance(x, ast.Name)}
    taken = {x.id for part in value.elts for x in ast.walk(part) if isinstance(x, ast.Name)}
    return bool(written & taken)
