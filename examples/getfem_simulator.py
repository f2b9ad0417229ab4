#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A block of neo-Hookean tissue that the finite-element package GetFEM computes, five to fourteen times
a second. At the end of a run it says how far its answers were from its own converged forces.
usage: getfem_simulator.py PORT      needs python3-getfem, python3-scipy (setup/install.sh fem)"""
import sys
import time

try:
    import getfem
    import numpy as np
    from scipy.sparse import csc_matrix
    from scipy.sparse.linalg import splu
except ImportError as missing:
    sys.exit("%s; 'setup/install.sh fem' installs it for /usr/bin/python3" % missing)

from forcegrid_link import LinkError, SimulatorLink

SIZE_M, NODES = (0.10, 0.10, 0.06), (10, 10, 7)
YOUNG_PA, POISSON = 5e3, 0.45
REACH_M, PATCH_M = 0.005, 0.015  # it catches a tool this near to the origin, by a patch this large
ENERGY = ("m/2*(Norm_sqr(Id(3)+Grad_u)-3) - m/2*log(Norm_sqr(Id(3)+Grad_u)+1)"
          "+ l/2*sqr(Det(Id(3)+Grad_u)-1-3*m/(4*l))")  # Smith, De Goes and Kim, ACM TOG 37(2), 2018
MU, LA = YOUNG_PA / (2 * (1 + POISSON)), YOUNG_PA * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
JUDGED = 10  # answers that are compared with converged ones


class Block:
    """Its top's middle is W's origin, its bottom is fixed, a patch moves with the tool."""

    def __init__(self):
        axes = [np.linspace(-s / 2, s / 2, n) for s, n in zip(SIZE_M, NODES)]
        axes[2] -= SIZE_M[2] / 2
        mesh = getfem.Mesh("regular simplices", *axes)
        self.fem = getfem.MeshFem(mesh, 3)
        self.fem.set_fem(getfem.Fem("FEM_PK(3,1)"))
        self.rule = getfem.MeshIm(mesh, getfem.Integ("IM_TETRAHEDRON(1)"))
        place = self.fem.basic_dof_nodes().T  # of each degree of freedom; x, y, z of a node in turn
        axis = np.arange(len(place)) % 3
        held = np.linalg.norm(place, axis=1) < PATCH_M
        self.free = np.flatnonzero(~held & (place[:, 2] > 1e-9 - SIZE_M[2]))
        self.patch = csc_matrix((held[:, None] & (axis[:, None] == range(3))).astype(float))
        self.forget()

    def forget(self):
        self.u, self.tool, self.follow = np.zeros(self.patch.shape[0]), np.zeros(3), 0.0

    def assembled(self, order):
        return getfem.asm_generic(self.rule, order, ENERGY, -1, "u", 1, self.fem, self.u, "m", 0,
                                  4 * MU / 3, "l", 0, LA + 5 * MU / 6)

    def step(self, tool_m):
        """One step of Newton's method. Returns force and dF/dP on the tool, and the residual."""
        self.u += self.patch @ (tool_m - self.tool)
        self.u[self.free] += self.follow @ (tool_m - self.tool) if np.ndim(self.follow) else 0.0
        self.tool = np.array(tool_m)
        its = self.assembled(2)
        tangent = csc_matrix((its.csc_val(), its.csc_ind()[1], its.csc_ind()[0]))
        across = (tangent @ self.patch)[self.free].toarray()
        solve = splu(tangent[self.free][:, self.free]).solve
        self.follow = -solve(across)  # the nodes' derivatives after the tool's place
        self.u[self.free] -= solve(self.assembled(1)[self.free])
        gradient = self.assembled(1)
        force = self.patch.T @ -gradient - self.follow.T @ gradient[self.free]  # what is left, too
        stiffness = -((self.patch.T @ tangent @ self.patch).toarray() + across.T @ self.follow)
        largest = max(np.linalg.norm(gradient), 1e-3)  # [N] nothing when at rest
        return force, stiffness, np.linalg.norm(gradient[self.free]) / largest

    def converged_force(self, tool_m):
        """The force on a tool that came here in a straight line."""
        self.forget()
        for share in [1 / 3, 2 / 3, 1] + 30 * [1]:
            force, _, residual = self.step(share * tool_m)
            if share == 1 and residual < 1e-8:
                return force
        raise RuntimeError("no equilibrium at %s m" % tool_m)


def judge(block, answers):
    chosen = [answers[i] for i in np.linspace(0, len(answers) - 1, JUDGED).astype(int)]
    true = np.array([block.converged_force(tool_m) for _, tool_m, _ in chosen])
    wrong = np.array([force for _, _, force in chosen]) - true
    percent = 100 * np.sqrt((wrong ** 2).sum() / (true ** 2).sum())
    rate_Hz = (len(answers) - 1) / (answers[-1][0] - answers[0][0])
    print("%.1f answers/s, within %.2g %% RMS of the converged force at %d of %d positions" %
          (rate_Hz, percent, len(chosen), len(answers)), flush=True)
    block.forget()


def main():
    try:
        link = SimulatorLink("127.0.0.1", int(sys.argv[1]))
    except (IndexError, ValueError):
        sys.exit(__doc__)
    except (LinkError, OSError, OverflowError) as error:
        sys.exit(str(error))
    block, caught, answers = Block(), None, []
    print("listening on 127.0.0.1:%d" % link.port, flush=True)
    while True:
        news = link.receive(0.1)
        if news.new_session or news.servo_ended:
            if len(answers) > 1:
                judge(block, answers)
            block.forget()
            caught, answers = None, []
        if news.tool_state:
            place_m = np.array(news.tool_state.position_W_m)
            if caught is None and np.linalg.norm(place_m) < REACH_M:
                caught = place_m
            if caught is None:
                link.answer(news.tool_state, [0.0] * 3, in_contact=False, converged=True)
                time.sleep(1 / 60)
                continue
            began_s = time.monotonic()
            force, stiffness, residual = block.step(place_m - caught)
            answers.append((began_s, place_m - caught, force))
            link.answer(news.tool_state, force, in_contact=True, converged=bool(residual < 1e-3),
                        contact_epoch=1, contact_point_W_m=caught, relative_residual=residual,
                        stiffness_W_N_per_m=stiffness.ravel(),
                        solve_time_s=time.monotonic() - began_s)


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        pass
