import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).parent.parent
PACKAGES = sorted(
    initial.parent.name
    for initial in (CHECKOUT / "src" / "traverse").glob("*/__init__.py")
)
SOURCES = sorted(path for name in PACKAGES for path in (CHECKOUT / name).rglob("*.py"))

MODULES = {"pickle", "marshal", "shelve", "dill", "cloudpickle", "joblib"}
FORBIDDEN = {
    "eval()",
    "exec()",
    "compile()",
    "__import__()",
    "os.system",
    "os.popen",
    "subprocess.getoutput",
    "subprocess.getstatusoutput",
    "asyncio.create_subprocess_shell",
    "yaml.load",
    "yaml.unsafe_load",
    "tempfile.mktemp",
    "ssl.CERT_NONE",
    "ssl._create_unverified_context",
    "shell=True",
    "allow_pickle=True",
    "tls_insecure=True",
    "check_hostname=False",
}


def forbidden(tree: ast.AST) -> list[str]:
    return [
        f"{node.lineno}: {name}"
        for node in ast.walk(tree)
        for name in names_of(node)
        if name in FORBIDDEN or name.partition(".")[0] in MODULES
    ]


def names_of(node: ast.AST) -> Iterator[str]:
    """Names that a node calls, imports or sets, in words of `FORBIDDEN`."""
    match node:
        case ast.Call(func=ast.Name(id=name)):
            yield f"{name}()"
        case ast.Import(names=names):
            yield from (imported.name for imported in names)
        case ast.ImportFrom(module=str(module), names=names):
            yield from (f"{module}.{imported.name}" for imported in names)
        case ast.Attribute(value=ast.Name(id=owner), attr=name):
            yield f"{owner}.{name}"
        case ast.keyword(arg=str(name), value=ast.Constant(value=value)):
            yield f"{name}={value}"
        case ast.Assign(
            targets=[ast.Attribute(attr=name)], value=ast.Constant(value=value)
        ):
            yield f"{name}={value}"


def test_there_are_sources_to_look_at():
    assert len(SOURCES) > 100


@pytest.mark.parametrize("package", PACKAGES)
def test_no_source_runs_text_or_unpacks_objects_or_calls_a_shell(package):
    calls = [
        f"{path.relative_to(CHECKOUT)}:{call}"
        for path in SOURCES
        if path.relative_to(CHECKOUT).parts[0] == package
        for call in forbidden(ast.parse(path.read_text("utf-8")))
    ]
    assert calls == []


@pytest.mark.parametrize(
    "text",
    [
        "eval('1')",
        "exec(x)",
        "import pickle",
        "import pickle as p",
        "from pickle import loads",
        "import os\nos.system('x')",
        "from os import system",
        "import subprocess\nsubprocess.run('x', shell=True)",
        "yaml.load(x)",
        "np.load(f, allow_pickle=True)",
        "ssl.CERT_NONE",
        "context.check_hostname = False",
        "Client(tls_insecure=True)",
    ],
)
def test_the_look_finds_what_it_is_for(text):
    assert forbidden(ast.parse(text))
