"""Each layer of the ablation is found in the product, and is restored afterwards."""

import pytest

from tests.tools.bench.ablation import FULL, LAYERS, Layer, figures, noted, table, without


@pytest.mark.parametrize("layer", LAYERS, ids=lambda layer: layer.name)
def test_ablation_disables_layer_temporarily(layer: Layer) -> None:
    before = layer.places
    with without(layer):
        assert all(vars(holder)[layer.function] is not function for holder, function in before)
    assert layer.places == before


def test_ablation_names_missing_layer() -> None:
    with (
        pytest.raises(LookupError, match="layer warp"),
        without(Layer("warp", "", "warp", "speed", lambda *_: None)),
    ):
        pass


def test_ablation_records_layer_as_active_if_results_differ() -> None:
    from circnav_mav.guidance import lap_plan

    plan = lap_plan.plan
    acted: set[str] = set()
    with noted(acted):
        assert lap_plan.plan((1.0, 0.0), V=15.0, r_d=100.0, limit=0.35) is None
    assert not acted, "the plan layer is inactive, because the circle is within the limit"
    with noted(acted):
        assert lap_plan.plan((9.0, 0.0), V=15.0, r_d=100.0, limit=0.35) is not None
    assert acted == {"lap plan"}
    assert lap_plan.plan is plan


def test_ablation_table_compares_medians_of_active_layers() -> None:
    row = "Rover R 20 V 3"
    flights = [
        {
            "layers": {
                FULL: figures(rms, 1.0, 0.0, 1, 1),
                "lap plan": figures(3.0, 2.0, 0.25, int(rms != 2.0), 1),
            }
        }
        for rms in (1.0, 3.0, 2.0)
    ]
    lines = table({row: flights}).splitlines()
    assert lines[2] == (
        f"| {row} | 2.00, 1.0 | - | - | - | - | - | 3.00, 2.0, 25 % (kept 2 of 3) | - | - |"
    )
    assert lines[3].startswith("| median ratio") and "| 1.50 |" in lines[3]
