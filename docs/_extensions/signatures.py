"""Signatures in the reference without what tells the command line how to parse them."""

from __future__ import annotations

import inspect
from types import UnionType
from typing import TYPE_CHECKING, Any, Union, get_args, get_origin

from sphinx.util.inspect import stringify_signature

if TYPE_CHECKING:
    from sphinx.application import Sphinx


def without_options(
    app: Sphinx, kind: str, name: str, function: Any, options: Any, arguments: str | None, returned: str | None
) -> tuple[str, str | None] | None:
    """The arguments as a script gives them: ``float`` of ``Annotated[float, typer.Option(...)]``."""
    if kind != "function":
        return None
    signature, scope = inspect.signature(function), inspect.unwrap(function).__globals__
    parameters = [
        parameter.replace(annotation=_plain(parameter.annotation, scope))
        for parameter in signature.parameters.values()
    ]
    plain = signature.replace(parameters=parameters)
    return stringify_signature(plain, show_return_annotation=False, unqualified_typehints=True), returned


def _plain(annotation: Any, scope: dict[str, Any]) -> Any:
    try:
        evaluated = eval(annotation, scope)  # as our own source has it
    except (NameError, TypeError):
        return annotation  # a name for type checkers only; no option has one
    if hasattr(evaluated, "__metadata__"):
        return get_args(evaluated)[0]
    return evaluated if annotation.isidentifier() and get_origin(evaluated) in (Union, UnionType) else annotation


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the change."""
    app.connect("autodoc-process-signature", without_options)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
