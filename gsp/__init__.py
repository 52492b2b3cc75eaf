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

__version__ = "0.2.0"

try:
    import lazy_loader

    # Nothing heavy is imported before it is used: SymPy, numba and SciPy cost most of a second together. The names are
    # listed once, in the stub beside this file.
    __getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
except KeyboardInterrupt:
    import os
    import sys

    # Of the command line, whose `main` has not begun; "-m" is the program's name until a module run so is found.
    if os.path.basename(sys.argv[0]) not in ("-m", "gsp", "gsp.exe"):
        raise
    print("gsp: interrupted; nothing was written", file=sys.stderr)
    sys.exit(130)
