"""gsp: geometric singular perturbation, from a system with two time scales to a measured reduction.

The pipeline, each verb taking the frozen noun of the one before:

    SlowFastSystem, VectorField   declare
    split                         find the slow and the fast variables
    solve_critical                the critical manifold, branch by branch
    classify                      where it is normally hyperbolic, how strongly, and how it ceases to be
    expand                        the slow manifold h_epsilon and the reduced field, as exact series
    restrict                      the reduced flow
    integrate                     trajectories of any of these
    compare                       the reduced flow against full trajectories
    choose                        the cheapest model that meets a scene's tolerance, "no" among the answers
    analyse, write_report         all of it for one scene

`dir(gsp)` lists all names, and `help(gsp.NAME)` says what each is for.
"""

import lazy_loader

__version__ = "0.2.0"

# Nothing heavy is imported before it is used: SymPy, numba and SciPy cost most of a second together. The names are
# listed once, in the stub beside this file.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
