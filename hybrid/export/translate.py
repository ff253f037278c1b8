"""The equations of one ship as array code without branches, from the source that numba compiles.

The physics is written once, as scalar functions for numba. Here their syntax trees are evaluated in part: what is
the same for one ship whatever it does (kinds of actuators, the hull's model, a propeller before a rudder) is
decided, what is not becomes code. Both sides of an ``if`` that remains are computed and merged by ``where``; loops
are unrolled; numbers of the ship are read by their names. Functions of numbers stay functions, with their
docstrings, functions of arrays dissolve into those that call them. The subset of Python that is understood is that
of the kernels: what is outside it raises :class:`Untranslatable`.

Both sides of a branch have to be finite for gradients. So divisors pass ``nonzero`` and roots ``root``, which
change nothing where the compiled code has a finite value.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import math
import operator
import re
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

Value = Any
"""What a name stands for in translation: Constant, Code, Record, FilledArray, Member, or a tuple of values."""


class Untranslatable(Exception):  # noqa: N818 - what it says of the code
    """Code outside the subset that is understood; says which function and line."""


class NoNumber(Untranslatable):
    """A value that is no number where the translated code needs one."""


@dataclass(frozen=True)
class Absent:
    """A value that the translated code does not have, and why."""

    why: str


@dataclass(frozen=True)
class Constant:
    """A value that is the same for the ship whatever it does: a number, a function, an array of kinds."""

    value: Any


@dataclass(frozen=True)
class Code:
    """A number that the translated code computes."""

    node: ast.expr


class Record:
    """A table of named numbers in the translated code; ``item`` gives one by its name, or its place.

    Functions that are called with records of the same ``shape`` are translated once.
    """

    def __init__(self, node: ast.expr, shape: Any, item: Callable[[ast.expr, Any, ast.expr | None], Value]) -> None:
        self.node, self.shape, self._item = node, shape, item

    def item(self, key: Any, written: ast.expr | None = None) -> Value:
        """The number of a name or place; ``written`` is how the source writes the place."""
        return self._item(self.node, key, written)

    def renamed(self, name: str) -> Record:
        """The same record under another name."""
        return Record(ast.Name(name), self.shape, self._item)


class EveryIndex:
    """The index of a loop over a :class:`Vector`, and the length of one."""


EVERY = EveryIndex()


class FilledArray:
    """An array that the source fills: its values, by place or by name; ``label`` begins their names."""

    def __init__(self, values: Mapping[Any, Value], label: str = "cell") -> None:
        self.values, self.label = dict(values), label


class Vector(FilledArray):
    """An array whose elements are all treated alike; a loop over it is code for the whole array."""

    def __init__(self, node: ast.expr) -> None:
        super().__init__({EVERY: Code(node)}, "values")

    @property
    def node(self) -> ast.expr:
        """The array as it now is."""
        return expression_of(self.values[EVERY])


class Work(FilledArray):
    """The working numbers of an actuator, called as the source writes their places: ``work[SHAFT_RPS]``.

    ``record`` stands for them once a function of the translated code has filled them.
    """

    def __init__(self, name: str, as_record: Callable[[ast.expr], Record]) -> None:
        super().__init__({}, name)
        self.as_record, self.record = as_record, _NO_RECORD

    record: Record | None


class WorkTable(FilledArray):
    """The working numbers of all actuators; in the translated code a record by the actuators' names."""

    def __init__(self, rows: Sequence[Work], as_record: Callable[[ast.expr], Record]) -> None:
        super().__init__(dict(enumerate(rows)), "work")
        self.as_record, self.node = as_record, _NO_NODE

    node: ast.expr | None


_NO_RECORD: Record | None = None
_NO_NODE: ast.expr | None = None


@dataclass(frozen=True)
class Member:
    """The number of an actuator; in a function of all actuators of its kind the code is a parameter, its name.

    Functions of actuators of the same ``shape`` are translated once.
    """

    index: int
    name: str
    shape: Any


def name_of(node: ast.expr) -> str:
    """How a place is called where it is written as a constant: ``work[propeller.SHAFT_RPS]`` is ``shaft_rps``."""
    if isinstance(node, ast.Name):
        return node.id.lower()
    if isinstance(node, ast.Attribute):
        return node.attr.lower()
    return ast.unparse(node)


def call(name: str, *arguments: ast.expr) -> ast.expr:
    """A call in the translated code."""
    return ast.parse(name, mode="eval").body if not arguments else ast.Call(_dotted_name(name), list(arguments), [])


def constant(value: Any) -> ast.expr:
    """A number as code."""
    if isinstance(value, bool | np.bool_):
        return ast.Constant(bool(value))
    number = float(value) if isinstance(value, float | np.floating) else int(value)
    if isinstance(number, float) and not math.isfinite(number):
        text = "xp.nan" if math.isnan(number) else "xp.inf"
        return _dotted_name(text) if not number < 0.0 else ast.UnaryOp(ast.USub(), _dotted_name(text))
    return ast.Constant(number) if number >= 0 else ast.UnaryOp(ast.USub(), ast.Constant(-number))


def subscript(node: ast.expr, key: Any) -> ast.expr:
    """``node[key]`` in the translated code."""
    return ast.Subscript(node, key if isinstance(key, ast.expr) else ast.Constant(key))


def _dotted_name(name: str) -> ast.expr:
    head, *rest = name.split(".")
    node: ast.expr = ast.Name(head)
    for part in rest:
        node = ast.Attribute(node, part)
    return node


FUNCTIONS: dict[Any, str] = {
    math.sin: "xp.sin", math.cos: "xp.cos", math.exp: "xp.exp", math.atan2: "angle_of", math.hypot: "length_of",
    math.sqrt: "root", math.asin: "arcsine", math.degrees: "xp.degrees", math.radians: "xp.radians",
    math.isnan: "xp.isnan", math.tan: "xp.tan", math.tanh: "xp.tanh", math.log: "xp.log",
    abs: "xp.abs", round: "xp.round", min: "xp.minimum", max: "xp.maximum", int: "xp.floor",
}  # fmt: skip
"""Functions of the source, and their names in the translated code; ``int`` is of numbers above zero."""

_BINARY = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
    ast.Pow: operator.pow, ast.FloorDiv: operator.floordiv, ast.Mod: operator.mod,
}  # fmt: skip
_COMPARE = {
    ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt, ast.GtE: operator.ge, ast.Eq: operator.eq,
    ast.NotEq: operator.ne, ast.Is: operator.is_, ast.IsNot: operator.is_not,
}  # fmt: skip


@dataclass
class Function:
    """A function of the translated code: its parameters, its statements, what it returns.

    ``wanted`` are names for the numbers that a call returns, where the source has them.
    """

    name: str
    parameters: list[str]
    docstring: str
    body: list[ast.stmt] = field(default_factory=list)
    names: set[str] = field(default_factory=set)
    result: Value = None
    wanted: tuple[str, ...] = ()

    def unused_name(self, preferred_name: str) -> str:
        """A name that nothing in the function has yet."""
        name, number = preferred_name, 1
        while name in self.names:
            number += 1
            name = f"{preferred_name}_{number}"
        self.names.add(name)
        return name

    def assign(self, preferred_name: str, node: ast.expr) -> ast.Name:
        """Bind a new name to code."""
        name = ast.Name(self.unused_name(preferred_name))
        self.body.append(ast.Assign([name], node))
        return name

    def text(self) -> str:
        """Its source."""
        lines = [f"def {self.name}({', '.join(self.parameters)}):"]
        if self.docstring:
            closing = '\n"""' if "\n" in self.docstring else '"""'
            lines += textwrap.indent(f'"""{self.docstring}{closing}', "    ").splitlines()
        source = "\n".join(ast.unparse(ast.fix_missing_locations(statement)) for statement in self.body)
        for statement in simplified(ast.parse(source).body):
            lines += ["    " + line for line in wrapped_lines(statement)]
        return "\n".join(lines)


class Translator:
    """Translates functions and those that they call; :attr:`functions` are in the order of definition.

    ``members`` are the ship's actuators.
    """

    def __init__(self, members: Sequence[Member], reserved: Sequence[str] = ()) -> None:
        self.functions: list[Function] = []
        self.members = members
        self._by_key: dict[Any, Function] = {}
        self._names: set[str] = set(reserved)

    def define_function(self, name: str, parameters: Sequence[str], docstring: str) -> Function:
        """A new function of the translated code, whose statements are to be added."""
        unique, number = name, 1
        while unique in self._names:
            number += 1
            unique = f"{name}_{number}"
        self._names.add(unique)
        return Function(unique, list(parameters), docstring, names={*parameters})

    def inline_call(self, function: Any, arguments: Sequence[Value], into: Function) -> Value:
        """The value of a call whose statements are added to ``into``."""
        return FunctionCall(self, function, into).value_for(arguments)

    def translate_call(self, function: Any, arguments: Sequence[Value], into: Function) -> Value:
        """The value of a call in ``into``: of a function of the translated code where its arguments allow that."""
        source = source_of(function)
        fills = isinstance(source.returns, ast.Constant)
        if source.args.vararg or not all(_can_be_passed(argument, fills) for argument in arguments):
            return self.inline_call(function, arguments, into)
        names = [argument.arg for argument in source.args.args]
        named = [
            (name, self._by_contract(name, value, names)) for name, value in zip(names, arguments, strict=True)
        ]
        key = (python_function(function), tuple(_shape(value) for _, value in named))
        if key not in self._by_key:
            self._by_key[key] = self._translated_function(function, named)
        translated = self._by_key[key]
        if _fills_cells(translated.result):  # arrays by place are no value of the translated code
            return self.inline_call(function, arguments, into)
        if _is_known(translated.result) and not any(isinstance(value, Work) for _, value in named):
            return translated.result
        passed = [node for _, value in named for node in _arguments_passing(value, into)]
        node = ast.Call(ast.Name(translated.name), passed, [])
        work = next((value for _, value in named if isinstance(value, Work)), None)
        if work is not None:
            work.record = work.as_record(into.assign(f"{work.label}_work", node))
            return Constant(None)
        actuator = next((value.name for _, value in named if isinstance(value, Member)), "")
        return _result_of(translated, node, into, actuator)

    def _by_contract(self, name: str, value: Value, names: Sequence[str]) -> Value:
        """By the contract of the kinds ``i`` is an actuator's number, ``first`` the place of its first control."""
        if name == "i" and isinstance(value, Constant) and "work" in names:
            return self.members[value.value]
        if name == "first" and isinstance(value, Constant) and "control" in names:
            return Code(constant(value.value))
        return value

    def _translated_function(self, function: Any, named: Sequence[tuple[str, Value]]) -> Function:
        parameters = [name for part, value in named for name in _argument_names(part, value)]
        target = Function("", parameters, inspect.getdoc(python_function(function)) or "", names={*parameters})
        inner = [_as_parameter(name, value) for name, value in named]
        target.result = self.inline_call(function, inner, target)
        work = next((value for value in inner if isinstance(value, Work)), None)
        if work is not None and work.values:
            pairs = work.values
            node: ast.expr = ast.Dict(
                [ast.Constant(key) for key in pairs], [expression_of(v) for v in pairs.values()]
            )
        elif _is_known(target.result) or _fills_cells(target.result):
            return target
        elif isinstance(target.result, tuple):
            node = ast.Tuple([expression_of(value) for value in target.result])
        else:
            node = expression_of(target.result)
        target.body.append(ast.Return(node))
        target.name = self.define_function(function_name(function), (), "").name
        self.functions.append(target)
        return target


def _result_of(function: Function, node: ast.expr, into: Function, actuator: str) -> Value:
    if isinstance(function.result, Vector):
        return Vector(node)
    if not isinstance(function.result, tuple):
        return Code(node)
    fields = getattr(function.result, "_fields", None)
    stem, size = actuator or function.name.removesuffix("_force"), len(function.result)
    wanted = fields or [f"{stem}_{axis}" for axis in ("XYN" if size == 3 else map(str, range(1, size + 1)))]
    if size == len(into.wanted) != 3:
        wanted = into.wanted
    names = [into.unused_name(name) for name in wanted]
    into.body.append(ast.Assign([ast.Tuple([ast.Name(name) for name in names])], node))
    values: tuple[Value, ...] = tuple(Code(ast.Name(name)) for name in names)
    kind: Any = type(function.result)
    return kind(*values) if fields else values


class FunctionCall:
    """The evaluation of one call of a function of the source: what its names stand for."""

    def __init__(self, translator: Translator, function: Any, into: Function) -> None:
        self.translator, self.into = translator, into
        self.function = python_function(function)
        self.source = source_of(function)
        self.names: dict[str, Value] = {}
        self.mine: set[str] = set()
        self.depth = 0
        closure = zip(self.function.__code__.co_freevars, self.function.__closure__ or (), strict=True)
        self.scope = {
            **vars(builtins),
            **self.function.__globals__,
            **{k: cell.cell_contents for k, cell in closure},
        }

    def value_for(self, arguments: Sequence[Value]) -> Value:
        """What the function returns for these arguments."""
        names = [argument.arg for argument in self.source.args.args]
        self.names = dict(zip(names, arguments, strict=False))
        if self.source.args.vararg:
            self.names[self.source.args.vararg.arg] = tuple(arguments[len(names) :])
        result = self.evaluate(self.source.body)
        return Constant(None) if result is None else result

    def evaluate(self, statements: Sequence[Any]) -> Value | None:
        """Evaluate statements; the value of a ``return``, or None where there is none."""
        for number, statement in enumerate(statements):
            rest = statements[number + 1 :]
            if isinstance(statement, ast.Return):
                return Constant(None) if statement.value is None else self.value_of(statement.value)
            if isinstance(statement, tuple):  # a turn of an unrolled loop begins
                self.names[statement[0]] = statement[1]
            elif isinstance(statement, ast.For):
                return self.evaluate([*self._unrolled_statements(statement), *rest])
            elif isinstance(statement, ast.If):
                test = self.value_of(statement.test)
                if isinstance(test, Constant):
                    return self.evaluate([*(statement.body if test.value else statement.orelse), *rest])
                if any(isinstance(node, ast.Return) for node in ast.walk(statement)):
                    return self._evaluate_branches(test, [*statement.body, *rest], [*statement.orelse, *rest])
                self._evaluate_branches(test, statement.body, statement.orelse)
            else:
                self._execute_simple(statement)
        return None

    def _unrolled_statements(self, loop: ast.For) -> Iterator[Any]:
        over = self.value_of(loop.iter)
        if not isinstance(loop.target, ast.Name) or not isinstance(over, Constant | tuple) or loop.orelse:
            raise self.refusal(loop, "a loop whose turns are not known")
        values = over if isinstance(over, tuple) else over.value
        for value in [values] if isinstance(values, EveryIndex) else values:
            yield (
                loop.target.id,
                value if isinstance(value, Code | Constant | FilledArray | Record) else Constant(value),
            )
            yield from loop.body

    def _execute_simple(self, statement: ast.stmt) -> None:
        if isinstance(statement, ast.Assign) and len(statement.targets) == 1:
            target: Any = statement.targets[0]
            parts = target.elts if isinstance(target, ast.Tuple) else ()
            self.into.wanted = tuple(part.id.strip("_") or "unused" for part in parts if isinstance(part, ast.Name))
            self._assign(target, self.value_of(statement.value))
            self.into.wanted = ()
        elif isinstance(statement, ast.AnnAssign) and statement.value is not None:
            self._assign(statement.target, self.value_of(statement.value))
        elif isinstance(statement, ast.AugAssign):
            target = statement.target
            reading = ast.parse(ast.unparse(target), mode="eval").body
            self._assign(target, self.value_of(ast.BinOp(reading, statement.op, statement.value)))
        elif isinstance(statement, ast.Expr):
            if not isinstance(statement.value, ast.Constant):
                self.value_of(statement.value)
        elif not isinstance(statement, ast.Pass):
            raise self.refusal(statement, f"a statement {type(statement).__name__.lower()}")

    def _assign(self, target: ast.expr, value: Value) -> None:
        if isinstance(target, ast.Tuple):
            values = [self._value_of_element(value, i) for i in range(len(target.elts))]
            for part, single in zip(target.elts, values, strict=True):
                self._assign(part, single)
        elif isinstance(target, ast.Name):
            self.names[target.id] = self._value_under_name(target.id, value)
        elif isinstance(target, ast.Subscript):
            cells, key = self.value_of(target.value), self.value_of(target.slice)
            if isinstance(cells, Work):
                cells.values[name_of(target.slice)] = self._value_under_name(name_of(target.slice), value)
            elif isinstance(cells, Vector) and isinstance(key.value, EveryIndex):
                cells.values[EVERY] = self._value_under_name(ast.unparse(target.value), value)
            elif isinstance(cells, FilledArray) and isinstance(key, Constant):
                cells.values[key.value] = self._value_under_name(f"{cells.label}_{key.value}", value)
            else:
                raise self.refusal(target, "an assignment to a place that is not known")
        else:
            raise self.refusal(target, "an assignment to it")

    def _value_under_name(self, preferred_name: str, value: Value) -> Value:
        """A value under a name of the translated code; names and known values need none."""
        if isinstance(value, Record) and not isinstance(value.node, ast.Name):
            return value.renamed(self._name_for_code(preferred_name, value.node).id)
        if isinstance(value, Vector) and not isinstance(value.node, ast.Name | ast.Constant):
            value.values[EVERY] = Code(self._name_for_code(preferred_name, value.node))
            return value
        if not isinstance(value, Code) or isinstance(value.node, ast.Name):
            return value
        return Code(self._name_for_code(preferred_name, value.node))

    def _name_for_code(self, preferred_name: str, node: ast.expr) -> ast.Name:
        """A name for code: again the one that the variable had, where nothing refers to that any more."""
        current = self.names.get(preferred_name)
        held = getattr(getattr(current, "node", None), "id", None)
        if held in self.mine and self.depth == 0:
            others = [value for name, value in self.names.items() if name != preferred_name]
            if not any(held in _names_in(value) for value in others):
                self.into.body.append(ast.Assign([ast.Name(held)], node))
                return ast.Name(held)
        name = self.into.assign(preferred_name, node)
        if self.depth == 0:
            self.mine.add(name.id)
        return name

    def _evaluate_branches(self, test: Code, body: Sequence[Any], orelse: Sequence[Any]) -> Value | None:
        """Both sides of a branch, merged: their returns, what their names stand for, and what they filled."""
        test = self._repeatable_test(test)
        arrays = [cells for value in self.names.values() for cells in _cells_in(value)]
        before, filled = dict(self.names), [dict(cells.values) for cells in arrays]
        self.depth += 1
        first = self.evaluate(body)
        names, values = self.names, [dict(cells.values) for cells in arrays]
        self.names = before.copy()
        for cells, content in zip(arrays, filled, strict=True):
            cells.values = content
        second = self.evaluate(orelse)
        self.depth -= 1
        for cells, content in zip(arrays, values, strict=True):
            for key in {**content, **cells.values}:
                merged = self.merged_value(test, content.get(key), cells.values.get(key))
                cells.values[key] = self._value_under_name(cells.label, merged)
        if first is not None or second is not None:
            return self.merged_value(test, first, second)
        merged_names = {
            name: self.merged_value(test, names.get(name), self.names.get(name)) for name in {**names, **self.names}
        }
        changed = {name for name, value in merged_names.items() if value is not before.get(name)}
        self.names = {**before, **{name: merged_names[name] for name in merged_names if name not in changed}}
        for name in sorted(changed, key=list(merged_names).index):
            later = [value for other, value in merged_names.items() if other in changed and other != name]
            held = getattr(getattr(before.get(name), "node", None), "id", None)
            reuse = held in self.mine and not any(held in _names_in(value) for value in later)
            self.names[name] = before[name] if reuse else None
            self.names[name] = self._value_under_name(name, merged_names[name])
        return None

    def _repeatable_test(self, test: Code) -> Code:
        """A condition short enough to be repeated, else under a name."""
        size = sum(1 for _ in ast.walk(test.node))
        return test if size <= 8 else Code(self.into.assign("condition", test.node))

    def merged_value(self, test: Code, first: Value, second: Value) -> Value:
        """The one value where a condition holds, else the other."""
        if first is None or second is None:  # a name that one side alone has
            return first if second is None else second
        if isinstance(first, tuple) and isinstance(second, tuple) and len(first) == len(second):
            parts = [self.merged_value(test, a, b) for a, b in zip(first, second, strict=True)]
            return type(first)(*parts) if hasattr(first, "_fields") else tuple(parts)
        if (
            first is second
            or not isinstance(first, Constant | Code)
            or ast.dump(expression_of(first)) == ast.dump(expression_of(second))
        ):
            return first
        return Code(call("where", test.node, expression_of(first), expression_of(second)))

    def refusal(self, node: ast.AST, what: str) -> Untranslatable:
        """The error of what is not understood, with its place."""
        place = f"{self.function.__module__}.{self.function.__name__}"
        return Untranslatable(f"{what} in {place}: {ast.unparse(node).splitlines()[0]}")

    # expressions

    def value_of(self, node: ast.expr) -> Value:
        """What an expression stands for."""
        method = self._METHODS.get(type(node))
        if method is None:
            raise self.refusal(node, f"an expression {type(node).__name__.lower()}")
        try:
            return method(self, node)
        except NoNumber as error:
            raise self.refusal(node, str(error)) from error

    def _value_of_constant(self, node: ast.Constant) -> Value:
        return Constant(node.value)

    def _value_of_name(self, node: ast.Name) -> Value:
        if node.id in self.names:
            return self.names[node.id]
        if node.id not in self.scope:
            raise self.refusal(node, "a name without a value")
        return Constant(self.scope[node.id])

    def _value_of_tuple(self, node: ast.Tuple) -> Value:
        return tuple(self.value_of(element) for element in node.elts)

    def _value_of_attribute(self, node: ast.Attribute) -> Value:
        owner = self.value_of(node.value)
        if isinstance(owner, Record):
            return owner.item(node.attr)
        if isinstance(owner, Constant):
            return Constant(getattr(owner.value, node.attr))
        if isinstance(owner, tuple) and hasattr(owner, node.attr):
            return getattr(owner, node.attr)
        raise self.refusal(node, "an attribute")

    def _value_of_subscript(self, node: ast.Subscript) -> Value:
        return self._value_of_element(self.value_of(node.value), self.value_of(node.slice), node.slice, node)

    def _value_of_element(
        self, owner: Value, key: Any, written: ast.expr | None = None, node: ast.AST | None = None
    ) -> Value:
        places = key if isinstance(key, tuple) else (key,)
        raw = [place.value if isinstance(place, Constant) else place for place in places]
        if isinstance(owner, WorkTable):
            row = owner.values[raw[0]]
            held = row.record or row
            last = written.elts[-1] if isinstance(written, ast.Tuple) else None
            return held if len(raw) == 1 else self._value_of_element(held, places[-1], last, node)
        if isinstance(owner, Work):
            return owner.values[name_of(written or ast.Constant(raw[0]))]
        if isinstance(owner, Record):
            return owner.item(tuple(raw) if len(raw) > 1 else raw[0], written)
        if isinstance(owner, Vector) and isinstance(raw[0], EveryIndex):
            return owner.values[EVERY]
        if isinstance(owner, FilledArray) and raw[0] in owner.values:
            return owner.values[raw[0]]
        if isinstance(owner, tuple | Constant) and not any(isinstance(place, Code) for place in raw):
            sequence: Any = owner.value if isinstance(owner, Constant) else owner
            element = sequence[tuple(raw) if len(raw) > 1 else raw[0]]
            return element if isinstance(owner, tuple) else Constant(element)
        raise self.refusal(node or ast.Constant("..."), "a place that is not known")

    def _value_of_slice(self, node: ast.Slice) -> Value:
        bounds = [
            None if part is None else self.value_of(part).value for part in (node.lower, node.upper, node.step)
        ]
        return Constant(slice(*bounds))

    def _value_of_unary(self, node: ast.UnaryOp) -> Value:
        operand = self.value_of(node.operand)
        if isinstance(operand, Constant):
            value = operand.value
            return Constant(not value if isinstance(node.op, ast.Not) else -value)
        if isinstance(node.op, ast.Not):
            return Code(call("xp.logical_not", operand.node))
        return Code(ast.UnaryOp(node.op, operand.node))

    def _value_of_binary(self, node: ast.BinOp) -> Value:
        left, right = self.value_of(node.left), self.value_of(node.right)
        if isinstance(left, Constant) and isinstance(right, Constant):
            return Constant(_BINARY[type(node.op)](left.value, right.value))
        if isinstance(left, Member):  # an index of an actuator is no number
            raise self.refusal(node, "arithmetic with an actuator's number")
        if isinstance(node.op, ast.Mult) and any(
            isinstance(side, Constant) and side.value == 0.0 for side in (left, right)
        ):
            return Constant(0.0)
        if isinstance(node.op, ast.Add | ast.Sub) and isinstance(right, Constant) and right.value == 0.0:
            return left
        if isinstance(node.op, ast.Add) and isinstance(left, Constant) and left.value == 0.0:
            return right
        divisor = expression_of(right)
        if isinstance(node.op, ast.Div) and not isinstance(right, Constant) and not _is_parameter(divisor):
            divisor = call("nonzero", divisor)
        return Code(ast.BinOp(expression_of(left), node.op, divisor))

    def _value_of_comparison(self, node: ast.Compare) -> Value:
        values = [self.value_of(part) for part in (node.left, *node.comparators)]
        tests: list[Value] = []
        for kind, left, right in zip(node.ops, values, values[1:], strict=False):
            if isinstance(kind, ast.Is | ast.IsNot) or (isinstance(left, Constant) and isinstance(right, Constant)):
                known = _COMPARE[type(kind)](getattr(left, "value", left), getattr(right, "value", right))
                tests.append(Constant(bool(known)))
            else:
                tests.append(Code(ast.Compare(expression_of(left), [kind], [expression_of(right)])))
        return self._all_of(tests, True)

    def _value_of_boolean(self, node: ast.BoolOp) -> Value:
        return self._all_of([self.value_of(part) for part in node.values], isinstance(node.op, ast.And))

    def _all_of(self, tests: Sequence[Value], conjunction: bool) -> Value:
        deciding = [test for test in tests if isinstance(test, Constant) and bool(test.value) != conjunction]
        if deciding:
            return deciding[0]
        open_tests = [test for test in tests if not isinstance(test, Constant)]
        if not open_tests:
            return Constant(conjunction)
        node = open_tests[0].node
        for test in open_tests[1:]:
            node = call("xp.logical_and" if conjunction else "xp.logical_or", node, test.node)
        return Code(node)

    def _value_of_conditional(self, node: ast.IfExp) -> Value:
        test = self.value_of(node.test)
        if isinstance(test, Constant):
            return self.value_of(node.body if test.value else node.orelse)
        return self.merged_value(test, self.value_of(node.body), self.value_of(node.orelse))

    def _value_of_call(self, node: ast.Call) -> Value:
        if node.keywords:
            raise self.refusal(node, "a call by keywords")
        if isinstance(node.func, ast.Attribute) and node.func.attr == "copy" and not node.args:
            original = self.value_of(node.func.value)
            return FilledArray(original.values, ast.unparse(node.func.value))
        function = self.value_of(node.func)
        if not isinstance(function, Constant):
            raise self.refusal(node, "a call of it")
        arguments: list[Value] = []
        for argument in node.args:
            value = self.value_of(argument.value if isinstance(argument, ast.Starred) else argument)
            arguments += value if isinstance(argument, ast.Starred) else [value]
        return self._value_of_call_to(function.value, arguments, node)

    def _value_of_call_to(self, function: Any, arguments: list[Value], node: ast.Call) -> Value:
        if function is len:
            return Constant(_length(arguments[0]))
        if function in (np.ones, np.zeros):
            start, size = Constant(float(function is np.ones)), arguments[0].value
            every = isinstance(size, EveryIndex)
            return (
                Vector(expression_of(start)) if every else FilledArray(dict.fromkeys(range(size), start), "share")
            )
        if function in (float, bool) and not isinstance(arguments[0], Constant):
            return arguments[0]
        if isinstance(function, type) and hasattr(function, "_fields"):
            return function(*arguments)
        if function is range and isinstance(arguments[0].value, EveryIndex):
            return arguments[0]
        if all(isinstance(argument, Constant) for argument in arguments) and not is_compiled(function):
            is_pure = function in (*FUNCTIONS, float, bool, range) or getattr(function, "__module__", "") == "math"
            if not is_pure:  # its result could be another at each call
                raise self.refusal(node, "a call of a function without a translation")
            return Constant(function(*(argument.value for argument in arguments)))
        if function in FUNCTIONS:
            return self._array_function(FUNCTIONS[function], [expression_of(argument) for argument in arguments])
        if not is_compiled(function):
            raise self.refusal(node, "a call of a function without a translation")
        return self.translator.translate_call(function, arguments, self.into)

    def _array_function(self, name: str, nodes: list[ast.expr]) -> Code:
        node = nodes[0] if len(nodes) > 2 else call(name, *nodes)
        for argument in nodes[1:] if len(nodes) > 2 else ():
            node = call(name, node, argument)
        return Code(node)

    _METHODS: ClassVar[dict[type, Callable[[FunctionCall, Any], Value]]] = {
        ast.Constant: _value_of_constant, ast.Name: _value_of_name, ast.Tuple: _value_of_tuple,
        ast.Attribute: _value_of_attribute, ast.Subscript: _value_of_subscript, ast.Slice: _value_of_slice,
        ast.UnaryOp: _value_of_unary, ast.BinOp: _value_of_binary, ast.Compare: _value_of_comparison,
        ast.BoolOp: _value_of_boolean, ast.IfExp: _value_of_conditional, ast.Call: _value_of_call,
    }  # fmt: skip


def python_function(function: Any) -> Any:
    """The function that numba compiles, as it is written."""
    return getattr(function, "py_func", function)


def is_compiled(function: Any) -> bool:
    """Whether a function is one of the kernels', or a user's force."""
    return hasattr(function, "py_func") or inspect.isfunction(function)


def function_name(function: Any) -> str:
    """The name of a function in the translated code: those of a kind of actuator or hull have its name before."""
    source = python_function(function)
    module, name = source.__module__.rpartition(".")[2], source.__name__.lstrip("_")
    return f"{module}_{name}" if name in ("force", "hold", "thrust", "inflow") else name


def source_of(function: Any) -> ast.FunctionDef:
    """The syntax tree of a function. Raises :class:`Untranslatable` where its source is not there."""
    plain = python_function(function)
    try:
        text = textwrap.dedent(inspect.getsource(plain))
    except (OSError, TypeError) as error:
        raise Untranslatable(f"the source of {getattr(plain, '__name__', plain)} is not there") from error
    tree = ast.parse(text).body[0]
    if not isinstance(tree, ast.FunctionDef):
        raise Untranslatable(f"{plain.__name__} is not a function by def")
    return tree


def expression_of(value: Value) -> ast.expr:
    """The syntax tree of a value. Raises :class:`NoNumber` for one that is no number."""
    if isinstance(value, Constant):
        return constant(value.value)
    if isinstance(value, Code | Vector):
        return value.node
    if isinstance(value, Absent):
        raise NoNumber(value.why)
    raise NoNumber(f"a {type(value).__name__.lower()} where a number should be")


def _is_known(value: Value) -> bool:
    return all(map(_is_known, value)) if isinstance(value, tuple) else isinstance(value, Constant)


def _fills_cells(value: Value) -> bool:
    if isinstance(value, tuple):
        return any(map(_fills_cells, value))
    return isinstance(value, FilledArray) and not isinstance(value, Vector)


def _length(value: Value) -> Any:
    if isinstance(value, Vector):
        return EVERY
    if isinstance(value, Record):
        return value.item(len).value
    return len(
        value.values if isinstance(value, FilledArray) else value.value if isinstance(value, Constant) else value
    )


def _can_be_passed(value: Value, fills: bool) -> bool:
    """Whether a function of the translated code can have it as an argument; one that fills arrays has none but an
    actuator's working numbers."""
    if isinstance(value, tuple):
        return hasattr(value, "_fields") and all(_can_be_passed(part, fills) for part in value)
    if isinstance(value, WorkTable):
        return all(row.record is not None for row in value.values.values())
    if isinstance(value, FilledArray):
        return isinstance(value, Work) if fills else isinstance(value, Vector)
    return isinstance(value, Code | Record | Member) or (
        isinstance(value, Constant) and not hasattr(value.value, "shape")
    )


def _shape(value: Value) -> Any:
    if isinstance(value, tuple):
        return (type(value), *map(_shape, value))
    if isinstance(value, Constant):
        return ("known", type(value.value), repr(value.value))
    return (type(value), getattr(value, "shape", None))


def _argument_names(name: str, value: Value) -> list[str]:
    """The names of the arguments by which a written function gets a value: none for constants and scratch."""
    if isinstance(value, tuple):
        fields: Any = getattr(value, "_fields", ())
        return [
            part for field, member in zip(fields, value, strict=True) for part in _argument_names(field, member)
        ]
    if isinstance(value, Constant | Work):
        return []
    return ["name" if isinstance(value, Member) else name]


def _as_parameter(name: str, value: Value) -> Value:
    """A value as the function that it is passed to sees it."""
    if isinstance(value, tuple):
        return type(value)(*map(_as_parameter, value._fields, value))  # type: ignore[attr-defined]
    if isinstance(value, Record):
        return value.renamed(name)
    if isinstance(value, WorkTable):
        return value.as_record(ast.Name(name))
    if isinstance(value, Work):
        return Work(value.label, value.as_record)
    if isinstance(value, Vector):
        return Vector(ast.Name(name))
    return Code(ast.Name(name)) if isinstance(value, Code) else value


def _arguments_passing(value: Value, into: Function) -> list[ast.expr]:
    """The arguments that pass a value."""
    if isinstance(value, tuple):
        return [node for part in value for node in _arguments_passing(part, into)]
    if isinstance(value, Constant | Work):
        return []
    if isinstance(value, Member):
        return [ast.Name("name") if "name" in into.parameters else ast.Constant(value.name)]
    if isinstance(value, WorkTable):
        if value.node is None:
            rows = {row.label: row.record.node for row in value.values.values()}
            value.node = into.assign("work", ast.Dict([ast.Constant(name) for name in rows], list(rows.values())))
        return [value.node]
    return [value.node if isinstance(value, Record) else expression_of(value)]


def _cells_in(value: Value) -> Iterator[FilledArray]:
    if isinstance(value, FilledArray):
        yield value
        for inner in value.values.values():
            yield from _cells_in(inner)
    elif isinstance(value, tuple):
        for part in value:
            yield from _cells_in(part)


def _names_in(value: Value) -> set[str]:
    """The names of the translated code that a value refers to."""
    if isinstance(value, tuple):
        return {name for part in value for name in _names_in(part)}
    if isinstance(value, FilledArray):
        return {name for part in value.values.values() for name in _names_in(part)}
    node = getattr(value, "node", None)
    return (
        {part.id for part in ast.walk(node) if isinstance(part, ast.Name)} if isinstance(node, ast.AST) else set()
    )


def _is_parameter(node: ast.expr) -> bool:
    """Whether code is of the ship's numbers alone, none of which is zero where something divides by it."""
    if isinstance(node, ast.BinOp):
        return _is_parameter(node.left) and _is_parameter(node.right)
    return isinstance(node, ast.Constant) or getattr(node, "of_ship", False)


_NUMBERED = re.compile(r"(.+?)_\d+")


def simplified(statements: list[ast.stmt]) -> list[ast.stmt]:
    """The statements without names that are used once, for a short expression, and with fewer numbers to names."""
    for statement in list(statements):
        target = _only_target(statement)
        uses = [node for other in statements for node in ast.walk(other) if _is_use(node, target)]
        if not target or not _NUMBERED.fullmatch(target) or len(uses) != 1:
            continue
        value = statement.value  # type: ignore[attr-defined]
        start = statements.index(statement)
        assigned = sum(target in _assigned_names(other) for other in statements)
        user = next((k for k in range(start + 1, len(statements)) if uses[0] in ast.walk(statements[k])), 0)
        if not user or assigned > 1:
            continue
        needed = {node.id for node in ast.walk(value) if isinstance(node, ast.Name)}
        between = {name for other in statements[start + 1 : user] for name in _assigned_names(other)}
        if len(ast.unparse(value)) <= _SHORT and not needed & between:
            statements[user] = _Replaced({target: value}).visit(statements[user])
            statements.remove(statement)
    for statement in reversed(list(statements)):  # what nothing uses, after what used it
        target = _only_target(statement)
        if target and not any(_is_use(node, target) for other in statements for node in ast.walk(other)):
            statements.remove(statement)
    for name in sorted({name for other in statements for name in _assigned_names(other)}):
        numbered = _NUMBERED.fullmatch(name)
        used = {node.id for other in statements for node in ast.walk(other) if isinstance(node, ast.Name)}
        if numbered and numbered[1] not in used and not numbered[1].endswith(("side", "turn")):
            statements = [_Replaced({name: ast.Name(numbered[1])}).visit(other) for other in statements]
    return [ast.parse(ast.unparse(ast.fix_missing_locations(other))).body[0] for other in statements]


_SHORT = 60


def _only_target(statement: ast.stmt) -> str:
    target = statement.targets[0] if isinstance(statement, ast.Assign) else None
    return target.id if isinstance(target, ast.Name) else ""


def _assigned_names(statement: ast.stmt) -> list[str]:
    targets = statement.targets if isinstance(statement, ast.Assign) else []
    return [node.id for target in targets for node in ast.walk(target) if isinstance(node, ast.Name)]


def _is_use(node: ast.AST, name: str) -> bool:
    return isinstance(node, ast.Name) and node.id == name and isinstance(node.ctx, ast.Load)


class _Replaced(ast.NodeTransformer):
    """Names replaced by expressions."""

    def __init__(self, expressions: Mapping[str, ast.expr]) -> None:
        self.expressions = expressions

    def visit_Name(self, node: ast.Name) -> ast.expr:
        """The expression for a name."""
        return self.expressions.get(node.id, node)


def wrapped_lines(statement: ast.stmt, width: int = 100) -> list[str]:
    """A statement on as many lines as it takes: sums by their terms, calls and tables by their members."""
    value = getattr(statement, "value", None)
    whole = _double_quoted(ast.unparse(statement))
    if len(whole) <= width or value is None:
        is_tuple = whole.startswith("return (") and isinstance(value, ast.Tuple)
        return [f"return {whole[8:-1]}" if is_tuple else whole]
    head = "return " if isinstance(statement, ast.Return) else whole[: whole.index(" = ") + 3]
    lines = _lines_of(value, width - 4)
    if lines[0].endswith("(") and lines[-1] == ")":
        return [head + lines[0], *lines[1:]]
    if isinstance(value, ast.Tuple):
        lines = [line for part in value.elts for line in _with_comma(_lines_of(part, width - 5))]
    return [f"{head}(", *(f"    {line}" for line in lines), ")"]


def _with_comma(lines: list[str]) -> list[str]:
    return [*lines[:-1], f"{lines[-1]},"]


def _lines_of(node: ast.expr, width: int) -> list[str]:
    """An expression on lines; a sum's first line has no sign before it."""
    text = _double_quoted(ast.unparse(node))
    if len(text) <= width:
        return [text]
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub | ast.Mult):
        sign = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*"}[type(node.op)]
        left = [f"({line})" if _is_sum(node.left) and sign == "*" else line for line in _lines_of(node.left, width)]
        right = _lines_of(node.right, width - 4)
        if len(left) > 1 and sign == "*":
            left = ["(", *(f"    {line.strip('()')}" for line in left), ")"]
        bracket = _is_sum(node.right)
        if len(right) == 1:
            return [*left, f"{sign} ({right[0]})" if bracket else f"{sign} {right[0]}"]
        if bracket:
            return [*left, f"{sign} (", *(f"    {line}" for line in right), ")"]
        return [*left, f"{sign} {right[0]}", *right[1:]]
    if isinstance(node, ast.Call):
        arguments = [line for part in node.args for line in _with_comma(_lines_of(part, width - 5))]
        return [f"{ast.unparse(node.func)}(", *(f"    {line}" for line in arguments), ")"]
    return [text]


def _is_sum(node: ast.expr) -> bool:
    return isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub)


def _double_quoted(text: str) -> str:
    return text.replace("'", '"')
