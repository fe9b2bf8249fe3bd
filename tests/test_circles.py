"""No modules import each other in a circle, not even late or for types only."""

import grimp


def circles(graph):
    """Return a chain of modules for every import that closes a circle."""
    loops = []
    for module in sorted(graph.modules):
        for other in sorted(graph.find_modules_directly_imported_by(module)):
            chain = graph.find_shortest_chain(other, module)
            if chain is not None:
                loops.append((module, *chain))
    return loops


def test_no_circle_of_imports():
    loops = circles(grimp.build_graph("traverse", "benchmarks", cache_dir=None))
    assert [" -> ".join(chain) for chain in loops] == []


def test_a_circle_is_found():
    graph = grimp.ImportGraph()
    for importer, imported in (("a", "b"), ("b", "c"), ("c", "a"), ("c", "d")):
        graph.add_import(importer=importer, imported=imported)
    assert ("a", "b", "c", "a") in circles(graph)
    assert not any("d" in chain for chain in circles(graph))
