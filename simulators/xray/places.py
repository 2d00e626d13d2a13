"""Where in the band lines and edges of a model are."""

from __future__ import annotations

from gaugeblock.simulators.xray.expression import Node, leaves

ENERGIES = {
    *((name, "El") for name in ("Gauss", "Zgauss", "Gabs")),
    *((name, "Ec") for name in ("Edge", "Zedge")),
    ("Lorentz", "E_l"),
}
"""Those that are energies of lines and edges: they lie in the band of the response."""


def places(tree: Node) -> dict[str, tuple[str, ...]]:
    """Energies of a model's lines and edges that are free, each with the other parameters of its components.

    >>> from gaugeblock.simulators.xray.expression import parse
    >>> places(parse("tbabs*(powerlaw+gauss)*edge"))
    {'gauss_1.El': ('gauss_1.sigma', 'gauss_1.norm'), 'edge_1.Ec': ('edge_1.tau',)}
    """
    found: dict[str, tuple[str, ...]] = {}
    for leaf in leaves(tree):
        free = {parameter: source for parameter, source in leaf.bindings if isinstance(source, str)}
        for parameter, source in free.items():
            if (leaf.component, parameter) in ENERGIES:
                beside = [other for other in free.values() if other != source]
                found[source] = tuple(dict.fromkeys([*found.get(source, ()), *beside]))
    return found
