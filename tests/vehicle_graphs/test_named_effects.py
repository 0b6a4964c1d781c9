"""Effects by name: where they act, in which order they are added, and which names are refused."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import pytest

from bondgraph.declare.domains import ROTATION, TRANSLATION
from bondgraph.declare.effect import Scale
from bondgraph.declare.graph import BondGraph
from bondgraph.effects import added_inertia, quadratic_loss, viscous_loss
from bondgraph.errors import OptionError
from vehicle_graphs import baja, emps, i3
from vehicle_graphs.named_effects import Extension, acting_at, with_effects

SCALE = Scale(100.0, 10.0)


def sled() -> BondGraph:
    g = BondGraph("sled")
    body = g.one_junction("body", TRANSLATION)
    g.inertance("mass", g.parameter("m_sled", 80.0, "kg", "sled with driver"), at=body)
    g.one_junction("reel", ROTATION)
    return g


EFFECTS = {
    "air": acting_at(quadratic_loss, "body", SCALE),
    "runners": acting_at(viscous_loss, "body", SCALE),
    "bearing": acting_at(viscous_loss, "reel", SCALE),
    "rope": acting_at(added_inertia, "reel", SCALE),
}


def test_effects_are_added_where_they_act_and_in_the_order_of_their_names() -> None:
    graph = with_effects(sled(), EFFECTS, ("bearing", "air"))
    assert [parameter.name for parameter in graph.parameters[1:]] == ["c_viscous_loss_reel", "c_quadratic_loss_body"]
    ends = {(bond.source, bond.target) for bond in graph.bonds}
    assert {("reel", "viscous_loss_reel"), ("body", "quadratic_loss_body")} <= ends


def test_the_scale_of_a_place_sets_the_bounds_there() -> None:
    small, large = (
        with_effects(sled(), {"air": acting_at(quadratic_loss, "body", scale)}, ("air",)).parameters[-1].bounds
        for scale in (SCALE, Scale(200.0, 10.0))
    )
    assert small is not None and large is not None
    assert large[1] == pytest.approx(2.0 * small[1])


def test_an_unknown_name_is_refused_before_anything_is_added() -> None:
    graph = sled()
    with pytest.raises(OptionError, match="sled: no effect 'runner'; did you mean 'runners'") as caught:
        with_effects(graph, EFFECTS, ("air", "runner"))
    assert caught.value.where == ("runner",)
    assert [parameter.name for parameter in graph.parameters] == ["m_sled"]


def test_an_effect_that_makes_no_sense_at_its_place_is_refused() -> None:
    with pytest.raises(OptionError, match="sled: added_inertia makes no sense at reel"):
        with_effects(sled(), EFFECTS, ("rope",))


@pytest.mark.parametrize("declared, effects", [(m.declared, m.EFFECTS) for m in (baja, emps, i3)])
def test_every_effect_of_a_machine_adds_something_beside_all_others(
    declared: Callable[[Sequence[str]], BondGraph], effects: Mapping[str, Extension]
) -> None:
    together = tuple(effects)
    everything = declared(together)
    for name in together:
        without = declared([other for other in together if other != name])
        assert len(without.bonds) < len(everything.bonds), name
