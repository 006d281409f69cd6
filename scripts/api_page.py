# SPDX-License-Identifier: MIT OR Apache-2.0
"""Write `docs/api.md` from the stub of the Python module: every public name with its signature and its text."""

from __future__ import annotations

import ast
import textwrap

from project import ROOT

STUB = ROOT / "native" / "python" / "dermis_native.pyi"
OUTPUT = ROOT / "docs" / "api.md"
WIDTH = 100


def source(node: ast.AST) -> str:
    """Python of a node, with the formatter's quotes."""
    return ast.unparse(node).replace("'", '"')


def signature(node: ast.FunctionDef, name: str) -> str:
    """A call with its types, one argument a line where it is long."""
    arguments = node.args
    plain = [each for each in arguments.args if each.arg not in ("self", "cls")]
    parts = [argument(each, None) for each in plain[: len(plain) - len(arguments.defaults)]]
    parts += [
        argument(each, value)
        for each, value in zip(plain[len(plain) - len(arguments.defaults) :], arguments.defaults, strict=True)
    ]
    if arguments.kwonlyargs:
        parts.append("*")
        parts += [
            argument(each, value) for each, value in zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True)
        ]
    given = "" if node.returns is None or name[0].isupper() else f" -> {source(node.returns)}"
    line = f"{name}({', '.join(parts)}){given}"
    if len(line) <= WIDTH:
        return line
    return f"{name}(\n" + "".join(f"    {part},\n" for part in parts) + f"){given}"


def argument(node: ast.arg, default: ast.expr | None) -> str:
    """One argument with its type and default."""
    text = node.arg + (f": {source(node.annotation)}" if node.annotation else "")
    return text + (f" = {source(default)}" if default is not None else "")


def described(node: ast.FunctionDef, name: str) -> list[str]:
    """Signature and text of a function."""
    return ["```python", signature(node, name), "```", "", *text_of(node)]


def text_of(node: ast.FunctionDef | ast.ClassDef | ast.Module) -> list[str]:
    """The doc string's lines."""
    text = ast.get_docstring(node)
    return [*text.splitlines(), ""] if text else []


def class_lines(node: ast.ClassDef) -> list[str]:
    """A class: how to make one, its methods, its properties as a list."""
    lines = [f"## {node.name}", "", *text_of(node)]
    properties = []
    for each in node.body:
        if not isinstance(each, ast.FunctionDef):
            continue
        decorators = {source(decorator) for decorator in each.decorator_list}
        if "property" in decorators:
            says = " ".join((ast.get_docstring(each) or "").split())
            properties.append(f"- `{each.name}: {source(each.returns) if each.returns else ''}` {says}".rstrip())
        elif each.name == "__new__":
            lines += described(each, node.name)
        elif not each.name.startswith("_"):
            lines += described(each, f"{node.name}.{each.name}" if "staticmethod" in decorators else f".{each.name}")
    return lines + ([*properties, ""] if properties else [])


def page() -> str:
    """The whole page."""
    module = ast.parse(STUB.read_text(encoding="utf-8"))
    aliases = [source(node) for node in module.body if isinstance(node, ast.Assign) and not is_names(node)]
    lines = ["# The Python module `dermis_native`", "", *text_of(module), "In signatures:", "", "```python"]
    lines += [*aliases, "```", ""]
    for node in module.body:
        if isinstance(node, ast.ClassDef):
            lines += class_lines(node)
        elif isinstance(node, ast.FunctionDef):
            lines += [f"## {node.name}", "", *described(node, node.name)]
    return textwrap.dedent("\n".join(lines)).rstrip() + "\n"


def is_names(node: ast.Assign) -> bool:
    """Whether this is the list of public names."""
    return source(node.targets[0]) == "__all__"


if __name__ == "__main__":
    OUTPUT.write_text(page(), encoding="utf-8")
