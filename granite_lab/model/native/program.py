"""A CasADi graph as a list of instructions, and which of them are the same over many lanes.

The contact arc is integrated at eight places, and each is the same piece of the graph with other
numbers. Instructions of one form whose operands are of one form make a group, which one vector
instruction evaluates. That leaves a third of the instructions, for the compiler, too.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

LANES = 8
"""Lanes of a vector, as many as the contact arc has places."""

FEWEST = 5
"""Fewer instructions of one form than this stay single."""


@dataclass(frozen=True)
class Node:
    """One instruction.

    Attributes:
        op: number of CasADi's operation.
        operands: numbers of the nodes that it works on.
        value: of a constant.
        place: number of the input and of the entry in it.
    """

    op: int
    operands: tuple[int, ...] = ()
    value: float = 0.0
    place: tuple[int, int] = (0, 0)


@dataclass(frozen=True)
class Program:
    """What an SX function computes.

    Attributes:
        nodes: instructions; each works on earlier ones only.
        results: number of the output, of its nonzero entry, and the node that holds it.
    """

    nodes: tuple[Node, ...]
    results: tuple[tuple[int, int, int], ...]


def read(f: Any) -> Program:
    """Read the instructions of an SX function."""
    at: dict[int, int] = {}
    nodes: list[Node] = []
    results = []
    for k in range(f.n_instructions()):
        op, source, target = f.instruction_id(k), f.instruction_input(k), f.instruction_output(k)
        if op == ca.OP_OUTPUT:
            results.append((target[0], target[1], at[source[0]]))
            continue
        if op == ca.OP_ASSIGN:
            at[target[0]] = at[source[0]]
            continue
        if op == ca.OP_CONST:
            node = Node(op, value=f.instruction_constant(k))
        elif op == ca.OP_INPUT:
            node = Node(op, place=(source[0], source[1]))
        else:
            node = Node(op, tuple(at[s] for s in source))
        at[target[0]] = len(nodes)
        nodes.append(node)
    return Program(tuple(nodes), tuple(results))


def schedule(program: Program) -> list[list[int]]:
    """Return the nodes in groups of at most `LANES`, each after all that it works on."""
    form: list[int] = []
    depth: list[int] = []
    forms: dict[tuple[int, ...], int] = {}
    members: dict[int, list[int]] = defaultdict(list)
    for k, node in enumerate(program.nodes):
        leaf = not node.operands
        key: tuple[int, ...] = (node.op, *(form[o] for o in node.operands))
        if leaf:  # numbers may differ from lane to lane
            key = ()
        form.append(forms.setdefault(key, len(forms)))
        depth.append(0 if leaf else 1 + max(depth[o] for o in node.operands))
        members[form[k]].append(k)
    groups: list[tuple[int, int, list[int]]] = []
    for nodes in members.values():
        pack = program.nodes[nodes[0]].operands and len(nodes) >= FEWEST
        width = LANES if pack else 1
        for start in range(0, len(nodes), width):
            group = nodes[start : start + width]
            if len(group) < FEWEST and width > 1:
                groups += [(depth[k], k, [k]) for k in group]
            else:
                groups.append((depth[group[0]], group[0], group))
    return [group for *_, group in sorted(groups)]


def used(groups: Sequence[Sequence[int]]) -> dict[int, tuple[int, int]]:
    """Return for each node of a group of several its group's number and its lane."""
    return {k: (g, lane) for g, group in enumerate(groups) if len(group) > 1 for lane, k in enumerate(group)}
