#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Finite elements against other people's codes: the same mesh, material and boundary.

usage: fem_peers_test.py FORCEGRID     the program
                                       exit status 77: a package is missing, nothing was compared

stvk and neo_hookean: GetFEM assembles forces and tangent, from its own law of St. Venant and
Kirchhoff and from the energy of the neo-Hookean one, differentiated by itself. corotated: SciPy
minimises an energy in NumPy. Reaction force and displacements at 20 positions of the tool have to
agree within 1e-6.
"""

import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

SKIPPED = 77
try:
    import numpy as np
    import scipy.optimize
    import scipy.sparse
    import scipy.sparse.linalg
except ImportError as missing:
    print(f"skipped: {missing}; setup/install.sh fem installs it")
    sys.exit(SKIPPED)
try:
    import getfem
except ImportError as missing:
    print(f"skipped: {missing}; setup/install.sh fem installs it")
    sys.exit(SKIPPED)

PROGRAM = sys.argv.pop(1)
YOUNG_PA, POISSON = 4.2e3, 0.42
MU = YOUNG_PA / (2 * (1 + POISSON))
LAMBDA = YOUNG_PA * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
RADIUS_M = 0.011
SEED = 2301
POSITIONS = 20
TOLERANCE = 1e-6


def make_mesh(random):
    """Points [m] and tetrahedra of a leaning block with a flat top; the bottom is at z = 0."""
    cells = (5, 4, 4)
    points, number = [], {}
    for x in range(cells[0] + 1):
        for y in range(cells[1] + 1):
            for z in range(cells[2] + 1):
                number[x, y, z] = len(points)
                at = np.array([0.011 * x, 0.012 * y, 0.009 * z])
                at[0] += 0.2 * at[2]
                if 0 < x < cells[0] and 0 < y < cells[1] and 0 < z < cells[2]:
                    at += random.uniform(-0.0012, 0.0012, 3)
                points.append(at)
    tetrahedra = []
    for x in range(cells[0]):
        for y in range(cells[1]):
            for z in range(cells[2]):
                for first, second, third in ((0, 1, 2), (1, 2, 0), (2, 0, 1),
                                             (0, 2, 1), (1, 0, 2), (2, 1, 0)):
                    corner = [x, y, z]
                    element = [number[tuple(corner)]]
                    for axis in (first, second, third):
                        corner[axis] += 1
                        element.append(number[tuple(corner)])
                    tetrahedra.append(element)
    points, tetrahedra = np.array(points), np.array(tetrahedra)
    edges = points[tetrahedra[:, 1:]] - points[tetrahedra[:, :1]]
    inverted = np.linalg.det(edges) < 0
    tetrahedra[inverted, 2:] = tetrahedra[inverted, 3:1:-1]
    return points, tetrahedra


def write_gmsh(path, points, tetrahedra):
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$Nodes", str(len(points))]
    lines += [f"{i + 1} {p[0]!r} {p[1]!r} {p[2]!r}" for i, p in enumerate(points.tolist())]
    lines += ["$EndNodes", "$Elements", str(len(tetrahedra))]
    lines += [f"{i + 1} 4 2 1 1 " + " ".join(str(v + 1) for v in t)
              for i, t in enumerate(tetrahedra.tolist())]
    path.write_text("\n".join(lines + ["$EndElements", ""]))


class Peer:
    """An equilibrium by Newton's method: subclasses give residual and tangent."""

    def __init__(self, points, tetrahedra, contact):
        self.points, self.tetrahedra = points, tetrahedra
        self.held = np.linalg.norm(points - contact, axis=1) <= RADIUS_M
        fixed = points[:, 2] <= 0.0
        self.held &= ~fixed
        self.free = np.repeat(~(fixed | self.held), 3)
        self.displacement = np.zeros(points.size)

    def solve(self, tool, steps=4):
        start = self.displacement[np.flatnonzero(np.repeat(self.held, 3))[:3]]
        for step in range(1, steps + 1):
            place = start + (tool - start) * step / steps
            self.displacement.reshape(-1, 3)[self.held] = place
            self.relax(np.linalg.norm(tool) * 1e-13)
        return -self.gradient(self.displacement).reshape(-1, 3)[self.held].sum(axis=0)

    def relax(self, aim_m):
        for _ in range(40):
            gradient = self.gradient(self.displacement)[self.free]
            tangent = self.tangent(self.displacement)[self.free][:, self.free].tocsc()
            move = scipy.sparse.linalg.spsolve(tangent, -gradient)
            self.displacement[self.free] += move
            if np.abs(move).max() < aim_m:
                return
        raise AssertionError("the peer does not converge")


class GetFem(Peer):
    """Forces and tangent as GetFEM assembles them from a weak form or an energy."""

    def __init__(self, points, tetrahedra, contact, expression):
        super().__init__(points, tetrahedra, contact)
        mesh = getfem.Mesh("empty", 3)
        for element in tetrahedra:
            mesh.add_convex(getfem.GeoTrans("GT_PK(3,1)"), points[element].T)
        self.fem = getfem.MeshFem(mesh, 3)
        self.fem.set_fem(getfem.Fem("FEM_PK(3,1)"))
        self.integration = getfem.MeshIm(mesh, getfem.Integ("IM_TETRAHEDRON(1)"))
        self.expression = expression
        # GetFEM numbers degrees of freedom as it likes: by place, three after each other.
        nodes = self.fem.basic_dof_nodes().T
        assert len(nodes) == points.size
        key = {tuple(np.round(p, 9)): i for i, p in enumerate(points)}
        vertex = np.array([key[tuple(np.round(p, 9))] for p in nodes])
        seen = np.zeros(len(points), dtype=int)
        self.place = np.empty(len(nodes), dtype=int)  # our number of each of its degrees
        for dof, i in enumerate(vertex):
            self.place[dof] = 3 * i + seen[i]
            seen[i] += 1

    def assembled(self, order, displacement):
        return getfem.asm_generic(self.integration, order, self.expression, -1, "u", 1, self.fem,
                                  displacement[self.place], "mu", 0, MU, "la", 0, LAMBDA)

    def gradient(self, displacement):
        result = np.empty(displacement.size)
        result[self.place] = self.assembled(1, displacement)
        return result

    def tangent(self, displacement):
        matrix = self.assembled(2, displacement)
        begin, row = matrix.csc_ind()
        its = scipy.sparse.csc_matrix((matrix.csc_val(), row, begin))
        back = scipy.sparse.csr_matrix(
            (np.ones(len(self.place)), (self.place, np.arange(len(self.place)))))
        return (back @ its @ back.T).tocsr()


class Corotated(Peer):
    """mu |F - R|^2 + la/2 (tr(R^T F) - 3)^2 from singular values, minimised by SciPy."""

    def __init__(self, points, tetrahedra, contact):
        super().__init__(points, tetrahedra, contact)
        edges = (points[tetrahedra[:, 1:]] - points[tetrahedra[:, :1]]).transpose(0, 2, 1)
        self.inverse = np.linalg.inv(edges)
        self.volume = np.abs(np.linalg.det(edges)) / 6

    def energy_and_gradient(self, displacement):
        places = self.points + displacement.reshape(-1, 3)
        edges = (places[self.tetrahedra[:, 1:]] - places[self.tetrahedra[:, :1]]).transpose(0, 2, 1)
        f = edges @ self.inverse
        u, stretch, v = np.linalg.svd(f)
        sign = np.sign(np.linalg.det(u @ v))
        u[:, :, 2] *= sign[:, None]
        stretch[:, 2] *= sign
        r = u @ v
        trace = stretch.sum(axis=1) - 3
        energy = (self.volume * (MU * ((stretch - 1) ** 2).sum(axis=1)
                                 + LAMBDA / 2 * trace ** 2)).sum()
        stress = 2 * MU * (f - r) + (LAMBDA * trace)[:, None, None] * r
        corner = (self.volume[:, None, None] * stress) @ self.inverse.transpose(0, 2, 1)
        gradient = np.zeros_like(places)
        for k in range(3):
            np.add.at(gradient, self.tetrahedra[:, k + 1], corner[:, :, k])
            np.add.at(gradient, self.tetrahedra[:, 0], -corner[:, :, k])
        return energy, gradient.ravel()

    def gradient(self, displacement):
        return self.energy_and_gradient(displacement)[1]

    def relax(self, aim_m):
        whole = self.displacement.copy()

        def at(free):
            whole[self.free] = free
            energy, gradient = self.energy_and_gradient(whole)
            return energy * 1e3, gradient[self.free] * 1e3

        def curvature(free, along):
            step = 1e-6 / max(np.abs(along).max(), 1e-30)
            return (at(free + step * along)[1] - at(free - step * along)[1]) / (2 * step)

        found = scipy.optimize.minimize(at, self.displacement[self.free], jac=True,
                                        hessp=curvature, method="trust-krylov",
                                        options={"gtol": 1e-8, "maxiter": 200})
        self.displacement[self.free] = found.x


class FemPeers(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.random = np.random.default_rng(SEED)
        print(f"seed {SEED}")
        cls.points, cls.tetrahedra = make_mesh(cls.random)
        cls.folder = tempfile.TemporaryDirectory()
        folder = pathlib.Path(cls.folder.name)
        write_gmsh(folder / "block.msh", cls.points, cls.tetrahedra)
        for model in ("corotated", "stvk", "neo_hookean"):
            (folder / f"{model}.toml").write_text(f"""\
description = "A leaning block"
patch_radius_m = {RADIUS_M}
[[object]]
shape = "mesh"
file = "block.msh"
unit = "m"
fixed_below_m = 0.0
[object.material]
model = "{model}"
youngs_modulus_Pa = {YOUNG_PA}
poissons_ratio = {POISSON}
density_kg_per_m3 = 1060.0
""")
        # The scene puts the surface point above the middle of the mesh's box at the origin.
        middle = 0.5 * (cls.points.min(axis=0) + cls.points.max(axis=0))
        cls.origin = np.array([middle[0], middle[1], cls.points[:, 2].max()])

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def forcegrid(self, model, tool, contact):
        command = [PROGRAM, "--no-config", "scene", os.path.join(self.folder.name, f"{model}.toml"),
                   "--force-at", ",".join(map(repr, tool.tolist())),
                   "--contact", ",".join(map(repr, (contact - self.origin).tolist())),
                   "--json", "--displacements"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 0, done.stderr)
        found = json.loads(done.stdout)
        self.assertTrue(found["converged"])
        return np.array(found["force_N"]), np.array(found["displacements_m"])

    def compare(self, model, make_peer, positions):
        top = self.points[:, 2].max()
        worst_force, worst_place = 0.0, 0.0
        for n in range(positions):
            contact = np.array([*self.random.uniform([0.02, 0.015], [0.045, 0.035]), top])
            tool = self.random.uniform([-0.004, -0.004, -0.006], [0.004, 0.004, 0.005])
            peer = make_peer(contact)
            expected = peer.solve(tool)
            force, displacements = self.forcegrid(model, tool, contact)
            worst_force = max(worst_force,
                              np.linalg.norm(force - expected) / np.linalg.norm(expected))
            worst_place = max(worst_place,
                              np.abs(displacements - peer.displacement.reshape(-1, 3)).max()
                              / np.linalg.norm(tool))
        print(f"{model}: {positions} positions, force within {worst_force:.1e}, displacements "
              f"within {worst_place:.1e} of the tool's")
        self.assertLess(worst_force, TOLERANCE)
        self.assertLess(worst_place, TOLERANCE)

    def test_stvk_is_getfems(self):
        weak = ("((Id(3)+Grad_u)*Saint_Venant_Kirchhoff_PK2(Grad_u,[la;mu])):Grad_Test_u")
        self.compare("stvk", lambda contact: GetFem(self.points, self.tetrahedra, contact, weak),
                     POSITIONS)

    def test_neo_hookean_is_what_getfem_makes_of_its_energy(self):
        m, stiff = "(4*mu/3)", "(la+5*mu/6)"
        energy = (f"{m}/2*(Norm_sqr(Id(3)+Grad_u)-3)"
                  f"+{stiff}/2*sqr(Det(Id(3)+Grad_u)-1-3*{m}/(4*{stiff}))"
                  f"-{m}/2*log(Norm_sqr(Id(3)+Grad_u)+1)")
        self.compare("neo_hookean",
                     lambda contact: GetFem(self.points, self.tetrahedra, contact, energy),
                     POSITIONS)

    def test_corotated_is_the_minimum_that_scipy_finds(self):
        self.compare("corotated",
                     lambda contact: Corotated(self.points, self.tetrahedra, contact), 1)


if __name__ == "__main__":
    unittest.main(verbosity=2)
