"""gsp: geometric singular perturbation, from a system with two time scales to a measured reduction.

The pipeline, each verb taking the frozen noun of the one before:

    SlowFastSystem, VectorField   declare
    split                         find the slow and the fast variables
    solve_critical                the critical manifold, branch by branch
    continue_critical             one curve of it through its folds, with its special points
    classify                      where it is normally hyperbolic, how strongly, and how it ceases to be
    certify                       the same proved over a box, in ball arithmetic, or refuted
    expand                        the slow manifold h_epsilon and the reduced field, as exact series
    bound_reduction               how far the reduced flow is from the full one over a span, proved
    canard_value                  the parameter of the maximal canard, as an exact series in epsilon
    folded_singularities          folded nodes, saddles, foci and saddle-nodes on a fold curve
    folded_canards, follow_canard the canards of a folded node as orbits, and each over epsilon
    zero_derivative               the slow manifold at points, to machine precision
    solve_manifold                the slow manifold over a region, attracting, repelling or of saddle type
    restrict                      the reduced flow
    integrate                     trajectories of any of these
    integrate_many                thousands of them, over starts, epsilon and parameters, on all cores
    periodic_orbit                a closed orbit, stable or not, by collocation
    hopf_points, continue_orbits  families of them: from a Hopf point through a canard explosion
    project                       where a start off the manifold lands: its fast fibre's base point
    composite                     the initial layer and the slow flow in one approximation
    fold_passage                  through a fold: delay, drop and exit
    singular_orbit                relaxation in the limit, and its period through epsilon ln epsilon
    mixed_mode                    large and small swings of a run, counted
    entry_exit                    how long an orbit stays on a branch that has lost its stability
    method_table                  the classical methods side by side
    compare                       the reduced flow against full trajectories
    work_precision                error against seconds: every integrator, and reduced models of every order
    failure_map                   where each method holds, measured
    choose                        the cheapest model that meets a scene's tolerance, "no" among the answers
    simulate                      that model over the span, the full system where it does not hold
    analyse, write_report         all of it for one scene
    demo, write_demo              one HTML file in which the scene's model runs: to move, to show, to teach
    animate                       a moving picture for slides
    export                        a reduced flow as text for Python, C, JavaScript, Julia, LaTeX or XPPAUT
    sweep                         one of these at every point of a grid, kept on disk and resumed
"""

import lazy_loader

__version__ = "0.2.0"

# Nothing heavy is imported before it is used: SymPy, numba and SciPy cost most of a second together. The names are
# listed once, in the stub beside this file.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
