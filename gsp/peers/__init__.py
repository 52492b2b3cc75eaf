"""Other people's integrators, run on our flows: what a work-precision diagram measures ours against.

`peer` says what one is; the others hold them by what they take: machine code (`solve_ivp`, `compiled`) or a text of
the equations (`compiled`). The scripts in `benchmarks/` measure more of them. Nothing foreign is imported before a
peer is prepared.
"""

from gsp.peers.compiled import DiffsolPeer, NumbalsodaPeer
from gsp.peers.peer import Peer, PeerRun, Solve
from gsp.peers.solve_ivp import ScipyPeer

PEERS: tuple[Peer, ...] = (
    ScipyPeer("Radau"),
    ScipyPeer("BDF"),
    ScipyPeer("LSODA"),
    NumbalsodaPeer(),
    DiffsolPeer("BDF", "bdf"),
    DiffsolPeer("ESDIRK34", "esdirk34"),
    DiffsolPeer("TR-BDF2", "tr_bdf2"),
)
"""All that there are adapters for, installed or not."""

__all__ = ["PEERS", "Peer", "PeerRun", "Solve"]
