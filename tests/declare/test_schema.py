"""The JSON schema of graph files: whatever is written and whatever is read fits it, and a wrong key does not."""

from __future__ import annotations

import copy
import importlib
import inspect
import json
import pkgutil
import random
from collections.abc import Iterator
from typing import Any

import pytest

import vehicle_graphs
from bondgraph.declare.files import graph_from_json, graph_to_json
from bondgraph.declare.graph import BondGraph
from bondgraph.declare.schema import graph_schema
from bondgraph.errors import BondGraphError, DeclarationError
from tests.declare.test_files import DC_MOTOR, everything
from tests.derive.fuzzed_graphs import spoiled
from tests.derive.random_graphs import RandomGraph
from tests.derive.test_textbook_files import CASES

jsonschema = pytest.importorskip("jsonschema")


@pytest.fixture(scope="module")
def schema() -> Any:
    jsonschema.Draft202012Validator.check_schema(graph_schema())
    return jsonschema.Draft202012Validator(graph_schema())


def _problems(schema: Any, data: Any) -> list[str]:
    return [f"{error.json_path}: {error.message}" for error in schema.iter_errors(data)]


def _written(graph: BondGraph) -> Any:
    return json.loads(json.dumps(graph_to_json(graph)))


def _declared() -> Iterator[tuple[str, BondGraph]]:
    """Every graph that a function of the package of vehicles gives by itself."""
    for found in pkgutil.iter_modules(vehicle_graphs.__path__, "vehicle_graphs."):
        module = importlib.import_module(found.name)
        for name, function in inspect.getmembers(module, inspect.isfunction):
            signature = inspect.signature(function)
            alone = all(one.default is not one.empty for one in signature.parameters.values())
            if function.__module__ == found.name and alone and "BondGraph" in str(signature.return_annotation):
                graph = function()
                if isinstance(graph, BondGraph):
                    yield f"{found.name}:{name}", graph


def test_graphs_of_the_packages_fit(schema: Any) -> None:
    graphs = dict(_declared())
    assert len(graphs) > 10 and "vehicle_graphs.ranger:full" in graphs
    assert {name: found for name, one in graphs.items() if (found := _problems(schema, _written(one)))} == {}


def test_every_declaration_fits(schema: Any) -> None:
    assert _problems(schema, _written(everything())) == []


@pytest.mark.parametrize("linear", [True, False])
def test_random_graphs_fit(schema: Any, linear: bool) -> None:
    for seed in range(80_000, 80_040):
        assert _problems(schema, _written(RandomGraph(seed, linear=linear, mesh=0.2).graph)) == [], seed


def test_files_of_strangers_fit(schema: Any) -> None:
    for case in CASES:
        assert _problems(schema, json.loads(json.dumps(case.graph))) == [], case.name


def test_whatever_is_read_fits(schema: Any) -> None:
    """Files spoiled at random: those that the reader takes are not refused by the schema."""
    read = 0
    for seed in range(600):
        data = json.loads(spoiled(random.Random(seed)))
        try:
            graph_from_json(data)
        except BondGraphError:
            continue
        read += 1
        assert _problems(schema, data) == [], seed
    assert read > 30


def _objects(value: Any) -> Iterator[dict[str, Any]]:
    """Every object of a file, but those whose keys are names."""
    children = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    if isinstance(value, dict):
        yield value
    for key, child in children:
        if key not in ("letters", "bind", "forms") and not (key == "ports" and isinstance(child, dict)):
            yield from _objects(list(child.values()) if key == "tables" else child)


def test_an_unknown_key_anywhere_is_refused_by_both(schema: Any) -> None:
    data = _written(everything())
    for k in range(len(list(_objects(data)))):
        spoilt = copy.deepcopy(data)
        list(_objects(spoilt))[k]["colour"] = "red"
        assert _problems(schema, spoilt)
        with pytest.raises(DeclarationError, match="colour"):
            graph_from_json(spoilt)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("graph", "format"), "bondgraph/2"), (("graph", "parameters", 0, "value"), "two"), (("directed",), False),
        (("graph", "parameters", 0, "bounds"), [1.0]), (("graph", "parameters", 0, "tolerance"), 4.0),
        (("nodes", 0, "kind"), "Q"), (("nodes", 0, "id"), 3),
        (("graph", "inputs", 0, "unit"), 7), (("graph", "outputs", 0, "variable"), "speed"), (("bonds", 0), {}),
        (("nodes", 2, "ports"), 0), (("nodes", 1, "domain"), "electric"),
    ],
)  # fmt: skip
def test_a_wrong_value_is_refused_by_both(schema: Any, path: tuple[Any, ...], value: Any) -> None:
    data = copy.deepcopy(DC_MOTOR)
    *way, last = path
    place: Any = data
    for key in way:
        place = place[key]
    place[last] = value
    assert _problems(schema, data)
    with pytest.raises(DeclarationError):
        graph_from_json(data)
