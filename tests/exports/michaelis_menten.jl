# Reduced flow of order 2 in epsilon: michaelis_menten, Michaelis-Menten: an enzyme, its substrate
# and their complex.
# Source: L. A. Segel and M. Slemrod, "The quasi-steady-state assumption", SIAM Review 31 (1989)
# 446-477
# Region: s in [0.05, 2], c in [0, 1].
# Measured error: 2.2e-06, the largest of a slow variable relative to its size, against the full
# system from the slow manifold at epsilon = 0.05 over t = 0 to 5.

# A start of s.
start = [1.0]

# The rates of s.
function rates(state, epsilon = 0.05; kappa = 1.0, lambda = 0.5)
    s = state[1]
    u0 = kappa + s
    u1 = lambda*s
    u2 = -lambda + u0
    u3 = kappa*s
    return [-(epsilon^2)*lambda*u2*u3*((kappa^2) - 2*kappa*lambda + 3*u1 + u3)/(u0^7) + epsilon*kappa*lambda*s*u2/(u0^4) - u1/u0]
end

# The slow manifold: c.
function slow_manifold(state, epsilon = 0.05; kappa = 1.0, lambda = 0.5)
    s = state[1]
    u0 = kappa + s
    u1 = kappa*s
    u2 = lambda*u1
    return [-(epsilon^2)*u2*((kappa^2) - 2*kappa*lambda + 3*lambda*s + u1)/(u0^7) + epsilon*u2/(u0^4) + s/u0]
end
