"""Imports run one way (docs/architecture.md)."""

import ast
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "warpdem"
# what each module or folder of the package may import, beside itself
ALLOWED = {
    "cache": {"errors"},
    "kernels": {"cache"},
    "errors": set(),
    "material": {"errors"},
    "section": {"errors"},
    "bond": {"errors", "material", "section"},
    "criteria": {"errors", "fields", "section"},
    "friction": {"errors", "material"},
    "contact": {"errors", "friction", "material", "packing", "relinking"},
    "wall": {"errors", "friction", "material"},
    "toughness": {"criteria", "errors", "material", "packing"},
    "plasticity": {"errors"},
    "relinking": {"errors"},
    "viscoelasticity": {"errors"},
    "room": {"errors"},
    "packing": {"errors", "room", "section"},
    "scene": {
        *("errors", "material", "bond", "criteria", "packing", "plasticity", "toughness"),
        *("contact", "friction", "relinking", "viscoelasticity", "wall"),
    },
    "model": {
        *("errors", "bond", "criteria", "kernels", "plasticity", "scene", "viscoelasticity"),
        *("contact", "friction", "material", "relinking", "wall"),
    },
    "archive": {"errors", "write"},
    "checkpoint": {"archive", "errors", "model", "wall"},
    "neighbours": {"errors", "kernels", "model"},
    "passes": {"errors", "kernels"},
    "patch": {"model", "passes"},
    "arrays": {"errors", "model", "room"},
    "step": {
        *("arrays", "errors", "friction", "kernels", "model", "neighbours", "passes", "patch"),
        *("relinking", "wall"),
    },
    "stability": {"errors", "model", "step"},
    "guard": {"errors", "model", "step"},
    "trouble": {"errors", "kernels", "model", "step"},
    "statics": {"errors", "model", "step"},
    "renewal": {"errors", "model", "packing", "step"},
    "moduli": {"errors", "bond", "material", "packing"},
    "fields": {"errors"},
    "simulation": {
        "arrays",
        *("errors", "bond", "fields", "model", "scene", "stability", "statics", "step", "trouble"),
        *("checkpoint", "cache", "guard", "passes", "relinking", "renewal", "wall"),
    },
    "observe": {"errors", "fields"},
    "write": {"errors", "fields", "observe", "wall"},
    "experiments": {
        *("errors", "material", "criteria", "packing", "scene", "simulation", "observe", "write"),
        *("bond", "checkpoint", "contact", "friction", "moduli", "toughness", "wall"),
    },
    "calibration": {"errors", "criteria", "experiments", "toughness"},
    "validation": {
        *("errors", "material", "section", "bond", "criteria", "packing", "scene", "simulation"),
        *("calibration", "moduli", "observe", "statics", "experiments", "plasticity", "toughness"),
        *("friction", "relinking", "viscoelasticity", "wall"),
    },
    "sweeps": {"errors", "experiments", "write"},
    "benchmark": {
        *(
            "errors",
            "passes",
            "bond",
            "criteria",
            "experiments",
            "material",
            "packing",
            "plasticity",
        ),
        *("scene", "section", "simulation", "validation", "write"),
    },
    "cli": {
        *("archive", "checkpoint", "errors", "experiments", "observe", "simulation", "sweeps"),
        *("benchmark", "validation", "write"),
    },
    "__main__": {"cli"},
}


def imports(path: Path) -> set[str]:
    """Modules and folders of the package that a file imports when it runs."""
    found = set()
    tree = ast.parse(path.read_text())
    checked_only = {
        inner
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        for inner in ast.walk(node)
    }
    inside = path.relative_to(PACKAGE).parts[:-1]
    for node in ast.walk(tree):
        if node in checked_only:
            continue
        if isinstance(node, ast.ImportFrom) and node.level:
            base = inside[: len(inside) - node.level + 1]
            for name in [node.module] if node.module else [a.name for a in node.names]:
                found.add((*base, *name.split("."))[0])
        elif isinstance(node, ast.ImportFrom | ast.Import):
            names = (
                [node.module] if isinstance(node, ast.ImportFrom) else [a.name for a in node.names]
            )
            assert not any(str(n).startswith("warpdem") for n in names), (
                f"{path}: import relatively"
            )
    return found


def test_imports_run_one_way():
    for path in PACKAGE.rglob("*.py"):
        part = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
        if part == "__init__":
            continue
        extra = imports(path) - ALLOWED[part] - {part}
        assert not extra, f"{path.name} imports {sorted(extra)}"


def test_no_circle_is_allowed():
    done: set[str] = set()
    while len(done) < len(ALLOWED):
        ready = {part for part, needs in ALLOWED.items() if needs <= done} - done
        assert ready, f"a circle among {sorted(set(ALLOWED) - done)}"
        done |= ready


def test_kernels_import_warp_alone():
    for path in (PACKAGE / "kernels").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                assert {a.name.split(".")[0] for a in node.names} <= {"warp"}, path.name
            elif isinstance(node, ast.ImportFrom) and not node.level:
                assert node.module in ("functools", "math", "types", "typing"), path.name


def test_kernels_link_leads_to_the_package():
    link = PACKAGE.parent / "kernels"
    assert link.resolve() == PACKAGE / "kernels" or link.is_file()
