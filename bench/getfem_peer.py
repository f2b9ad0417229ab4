#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""GetFEM's own nonlinear solve beside this project's solver: same elements, boundary and motion.
Prints processor time per answer at 30 Hz and force error of both, and the ratio. The goal is 20.
usage: getfem_peer.py BUILD/bin/forcegrid_solver_steps [SCENE [SECONDS]]     needs python3-getfem

Both hold the vertices around the top of the scene (liver) and move them along the motion of
`forcegrid simulate --bench`. Errors are against the converged force. GetFEM gets the energy as an
expression, which it differentiates itself, and solves for the free nodes alone (Model.solve),
from its last solution, with MUMPS. Its time is of that call alone: neither set-up nor reading the
force counts. It runs at several tolerances; what counts is its cheapest run whose error is at most
ours. Both have one thread."""
import os

for libraries in ("OMP", "OPENBLAS", "MKL"):
    os.environ[libraries + "_NUM_THREADS"] = "1"
import subprocess
import sys
import time

try:
    import getfem
    import numpy as np
except ImportError as missing:
    sys.exit(f"{missing}; 'setup/install.sh fem' installs it for /usr/bin/python3")

FREE, HELD = 0, 2
F = "(Id(3)+Grad_u+Grad_w)"
ENERGY = (f"m/2*(Norm_sqr({F})-3) - m/2*log(Norm_sqr({F})+1)"
          f"+ l/2*sqr(Det({F})-1-3*m/(4*l))")
OURS = [1e-2, 1e-3]  # tolerances of the relative residual
RESIDUALS = [1e-2, 1e-3, 1e-4]  # max_res of Model.solve, over the RMS force
SETTLING = 15  # answers that do not count
GOAL = 20.0


class Task:
    """What forcegrid_solver_steps says: the object, the tool's motion and our answers along it."""

    def __init__(self, program, scene, seconds):
        done = subprocess.run([program, scene, seconds, *map(str, OURS)], stdout=subprocess.PIPE,
                              text=True)
        if done.returncode != 0:
            sys.exit(1)  # it has said why
        out = done.stdout.splitlines()
        vertices, elements, ticks = map(int, out[0].split()[:3])
        self.young_Pa, self.poisson = map(float, out[0].split()[3:])
        table = [[float(x) for x in line.split()] for line in out[1:]]
        self.points = np.array(table[:vertices])[:, :3]
        self.state = np.array(table[:vertices])[:, 3]
        self.tetrahedra = np.array(table[vertices:vertices + elements], dtype=int)
        rows = np.array(table[vertices + elements:])
        assert len(rows) == ticks > SETTLING
        self.motion, self.converged, self.answers = rows[:, :3], rows[:, 3:6], rows[:, 6:]


class GetFem:
    """u: the free nodes' displacements, the unknown; w: those of the nodes that the tool holds."""

    def __init__(self, task):
        mesh = getfem.Mesh("empty", 3)
        for element in task.tetrahedra:
            mesh.add_convex(getfem.GeoTrans("GT_PK(3,1)"), task.points[element].T)
        self.fem = getfem.MeshFem(mesh, 3)
        self.fem.set_fem(getfem.Fem("FEM_PK(3,1)"))
        self.rule = getfem.MeshIm(mesh, getfem.Integ("IM_TETRAHEDRON(1)"))
        place = self.fem.basic_dof_nodes().T  # of each degree of freedom; x, y, z of a node in turn
        number = {tuple(np.round(p, 9)): i for i, p in enumerate(task.points)}
        state = task.state[[number[tuple(np.round(p, 9))] for p in place]]
        assert len(place) == task.points.size and (np.diff(state.reshape(-1, 3)) == 0).all()
        self.held, self.free = np.flatnonzero(state == HELD), np.flatnonzero(state == FREE)
        mu = task.young_Pa / (2 * (1 + task.poisson))
        la = task.young_Pa * task.poisson / ((1 + task.poisson) * (1 - 2 * task.poisson))
        self.m, self.l = 4 * mu / 3, la + 5 * mu / 6
        model = self.model = getfem.Model("real")
        model.add_fem_variable("u", getfem.MeshFem("partial", self.fem, self.free))
        model.add_fem_data("w", self.fem)
        model.add_initialized_data("m", [self.m])
        model.add_initialized_data("l", [self.l])
        model.add_nonlinear_term(self.rule, ENERGY)
        self.w = np.zeros(len(place))

    def move_to(self, displacement, largest_residual):
        """Returns the processor time [s] of the solve."""
        self.w[self.held] = np.tile(displacement, len(self.held) // 3)
        self.model.set_variable("w", self.w)
        began_s = time.process_time()
        self.iterations, converged = self.model.solve(
            "max_res", largest_residual, "max_iter", 30, "lsolver", "mumps")
        took_s = time.process_time() - began_s
        assert converged, "GetFEM does not converge"
        return took_s

    def force(self):
        """[N] on the tool: minus the sum of the energy's gradient over the nodes that it holds."""
        whole = self.w.copy()
        whole[self.free] += self.model.variable("u")
        gradient = getfem.asm_generic(
            self.rule, 1, ENERGY.replace("+Grad_w", ""), -1, "u", 1, self.fem, whole,
            "m", 0, self.m, "l", 0, self.l)
        return -gradient[self.held].reshape(-1, 3).sum(axis=0)


def error_percent(forces, converged):
    return 100 * np.sqrt(((forces - converged)[SETTLING:] ** 2).sum()
                         / (converged[SETTLING:] ** 2).sum())


def main():
    if len(sys.argv) not in (2, 3, 4):
        sys.exit(__doc__)
    scene, seconds = (sys.argv[2:] + ["liver", "1.5"][len(sys.argv) - 2:])
    getfem.util_trace_level(0)
    task = Task(sys.argv[1], scene, seconds)
    converged = task.converged
    ours = []
    for k, tolerance in enumerate(OURS):
        mine = task.answers[:, 4 * k:4 * k + 4]
        ours.append((tolerance, mine[SETTLING:, 3].mean(), error_percent(mine[:, :3], converged)))
        print("forcegrid, residual %-7g        %9.3f ms, error %.2g %%" % ours[-1])

    size_N = np.sqrt((converged ** 2).sum(axis=1).mean())
    peers = []
    for residual in RESIDUALS:
        peer = GetFem(task)
        times, forces, iterations = [], [], []
        for place in task.motion:
            times.append(peer.move_to(place, residual * size_N))
            iterations.append(peer.iterations)
            forces.append(peer.force())
        peers.append((1e3 * np.mean(times[SETTLING:]), error_percent(np.array(forces), converged)))
        print("GetFEM, max_res %-10g           %9.3f ms, error %.2g %%, %.1f iterations"
              % (residual, *peers[-1], np.mean(iterations[SETTLING:])), flush=True)
    for tolerance, time_ms, error in ours:
        enough = [peer_ms for peer_ms, peer_error in peers if peer_error <= error]
        if not enough:
            sys.exit(f"no run of GetFEM is within {error:.2g} %")
        ratio = min(enough) / time_ms
        print(f"ratio at our residual of {tolerance:g}: {ratio:.0f} (goal: {GOAL:g})")


if __name__ == "__main__":
    main()
