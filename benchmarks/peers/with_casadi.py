"""Output error by CasADi: single shooting with ipopt and a Gauss-Newton Hessian, as in its example `sysid.py`."""

from __future__ import annotations

import casadi as ca

from benchmarks.peers.log import HIGH, LOW, START, read, say


def main() -> None:
    time, torque, heading = read()
    state, push, step = ca.SX.sym("state", 2), ca.SX.sym("push"), ca.SX.sym("step")
    share = ca.SX.sym("share", 3)  # of where the search starts
    inertia, quadratic, linear = ca.vertsplit(share * ca.DM(START))

    def change(at: ca.SX) -> ca.SX:
        rate = at[1]
        return ca.vertcat(rate, (push - (quadratic * ca.fabs(rate) + linear) * rate) / inertia)

    k1 = change(state)
    k2 = change(state + step / 2 * k1)
    k3 = change(state + step / 2 * k2)
    k4 = change(state + step * k3)
    ahead = ca.Function("ahead", [state, push, step, share], [state + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)])
    count = len(time) - 1
    shares = ca.MX.sym("shares", 3)
    begin = ca.DM([heading[0], 0.0])
    states = ahead.mapaccum("course", count)(
        begin, torque[:-1].reshape(1, -1), (time[1:] - time[:-1]).reshape(1, -1), ca.repmat(shares, 1, count)
    )
    residual = ca.DM(heading[1:]) - states[0, :].T
    problem = {"x": shares, "f": 0.5 * ca.dot(residual, residual)}
    slopes, scale = ca.jacobian(residual, shares), ca.MX.sym("scale")
    curvature = ca.Function(
        "nlp_hess_l",
        {"x": shares, "lam_f": scale, "hess_gamma_x_x": scale * ca.triu(ca.mtimes(slopes.T, slopes))},
        ["x", "p", "lam_f", "lam_g"],
        ["hess_gamma_x_x"],
    )
    quiet = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
    solver = ca.nlpsol("solver", "ipopt", problem, {"hess_lag": curvature, **quiet})
    bounds = [[bound / value for bound, value in zip(bounds, START, strict=True)] for bounds in (LOW, HIGH)]
    found = solver(x0=[1.0, 1.0, 1.0], lbx=bounds[0], ubx=bounds[1])
    say((found["x"] * ca.DM(START)).full().ravel())


if __name__ == "__main__":
    main()
