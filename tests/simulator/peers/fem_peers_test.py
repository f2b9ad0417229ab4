#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Finite elements against other people's codes: the same mesh, material and boundary.

usage: fem_peers_test.py FORCEGRID PEER     the program; the peer's class: GetFemPeer, FreeFemPeer
                                            or SciPyPeer
                                            exit status 77: a package of the peer's is missing

stvk and neo_hookean: GetFEM assembles forces and tangent, from its own law of St. Venant and
Kirchhoff and from the energy of the neo-Hookean one, differentiated by itself. FreeFem assembles
and solves what press_block.edp writes down by hand. corotated: SciPy minimises an energy in NumPy.
Reaction force and displacements at 20 positions of the tool have to agree within 1e-6.
"""

import json
import os
import pathlib
import shutil
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
except ImportError:
    getfem = None
FREEFEM = shutil.which("FreeFem++-nw")

PROGRAM = sys.argv.pop(1)
FREEFEM_SCRIPT = pathlib.Path(__file__).resolve().with_name("press_block.edp")
LOAD_STEPS = 4
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


def write_medit(path, points, tetrahedra):
    lines = ["MeshVersionFormatted 2", "Dimension 3", "Vertices", str(len(points))]
    lines += [f"{p[0]!r} {p[1]!r} {p[2]!r} 0" for p in points.tolist()]
    lines += ["Tetrahedra", str(len(tetrahedra))]
    lines += [" ".join(str(v + 1) for v in t) + " 0" for t in tetrahedra.tolist()]
    path.write_text("\n".join(lines + ["End", ""]))


def held_by(points, contact):
    """Which points the tool holds: those in its patch that are not fixed."""
    return (np.linalg.norm(points - contact, axis=1) <= RADIUS_M) & (points[:, 2] > 0.0)


class Peer:
    """An equilibrium by Newton's method: subclasses give residual and tangent."""

    def __init__(self, points, tetrahedra, contact):
        self.points, self.tetrahedra = points, tetrahedra
        self.held = held_by(points, contact)
        fixed = points[:, 2] <= 0.0
        self.free = np.repeat(~(fixed | self.held), 3)
        self.displacement = np.zeros(points.size)

    def solve(self, tool, steps=LOAD_STEPS):
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

        numbers = 3 * tetrahedra[:, :, None] + np.arange(3)
        self.numbers = numbers.reshape(len(tetrahedra), 12)  # of an element's degrees of freedom

    def of_elements(self, corners):
        """Energy of each element [J], and its gradient by the places `corners` (n, 4, 3) [N]."""
        edges = (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
        f = edges @ self.inverse
        u, stretch, v = np.linalg.svd(f)
        sign = np.sign(np.linalg.det(u @ v))
        u[:, :, 2] *= sign[:, None]
        stretch[:, 2] *= sign
        r = u @ v
        trace = stretch.sum(axis=1) - 3
        energy = self.volume * (MU * ((stretch - 1) ** 2).sum(axis=1) + LAMBDA / 2 * trace ** 2)
        stress = 2 * MU * (f - r) + (LAMBDA * trace)[:, None, None] * r
        corner = ((self.volume[:, None, None] * stress)
                  @ self.inverse.transpose(0, 2, 1)).transpose(0, 2, 1)
        return energy, np.concatenate([-corner.sum(axis=1, keepdims=True), corner], axis=1)

    def corners(self, displacement):
        return (self.points + displacement.reshape(-1, 3))[self.tetrahedra]

    def energy_and_gradient(self, displacement):
        energy, by_corner = self.of_elements(self.corners(displacement))
        gradient = np.zeros(displacement.size)
        np.add.at(gradient, self.numbers, by_corner.reshape(-1, 12))
        return energy.sum(), gradient

    def gradient(self, displacement):
        return self.energy_and_gradient(displacement)[1]

    def tangent(self, displacement):
        """Central differences of the gradients: they say how fast it converges, not to what."""
        corners, step = self.corners(displacement), 1e-7
        blocks = np.empty((len(corners), 12, 12))
        for k in range(12):
            moved = np.zeros((1, 4, 3))
            moved.flat[k] = step
            difference = self.of_elements(corners + moved)[1] - self.of_elements(corners - moved)[1]
            blocks[:, :, k] = difference.reshape(-1, 12) / (2 * step)
        tangent = np.zeros((displacement.size, displacement.size))
        np.add.at(tangent, (self.numbers[:, :, None], self.numbers[:, None, :]), blocks)
        return 0.5 * (tangent + tangent.T)

    def relax(self, aim_m):
        whole = self.displacement.copy()
        scale = 1e3

        def at(free):
            whole[self.free] = free
            energy, gradient = self.energy_and_gradient(whole)
            return scale * energy, scale * gradient[self.free]

        def curvature(free):
            whole[self.free] = free
            return scale * self.tangent(whole)[np.ix_(self.free, self.free)]

        found = scipy.optimize.minimize(at, self.displacement[self.free], jac=True, hess=curvature,
                                        method="trust-exact", options={"gtol": 1e-8, "maxiter": 200})
        self.displacement[self.free] = found.x


def solve_with_freefem(folder, model, cases):
    """Force [N] and displacements [m] of each case (contact, tool), as FreeFem solves them."""
    points, tetrahedra = cases.mesh
    write_medit(folder / "block.mesh", points, tetrahedra)
    lines = [f"{model} {MU!r} {LAMBDA!r} {LOAD_STEPS} {len(cases.places)}"]
    for contact, tool in cases.places:
        held = np.flatnonzero(held_by(points, contact))
        lines.append(" ".join(map(repr, [*tool.tolist(), len(held), *held.tolist()])))
    (folder / "cases.txt").write_text("\n".join(lines + [""]))
    done = subprocess.run([FREEFEM, "-ne", "-v", "0", str(FREEFEM_SCRIPT)], cwd=folder,
                          capture_output=True, text=True, timeout=500)
    if done.returncode != 0:
        raise AssertionError(f"FreeFem ended with {done.returncode}: {done.stdout}{done.stderr}")
    rows = np.loadtxt(folder / "found.txt").reshape(len(cases.places), 1 + len(points), 3)
    return [(answer[0], answer[1:]) for answer in rows]


class Cases:
    """The mesh and the tool's places: pairs of the contact [m] and the displacement [m]."""

    def __init__(self, seed, count):
        random = np.random.default_rng(seed)
        self.mesh = make_mesh(random)
        top = self.mesh[0][:, 2].max()
        self.places = [(np.array([*random.uniform([0.02, 0.015], [0.045, 0.035]), top]),
                        random.uniform([-0.004, -0.004, -0.006], [0.004, 0.004, 0.005]))
                       for _ in range(count)]


class Comparison(unittest.TestCase):
    """What the peers have in common; it has no test of its own."""

    @classmethod
    def setUpClass(cls):
        print(f"seed {SEED}")
        cls.cases = Cases(SEED, POSITIONS)
        cls.points, cls.tetrahedra = cls.cases.mesh
        cls.temporary = tempfile.TemporaryDirectory()
        cls.folder = pathlib.Path(cls.temporary.name)
        write_gmsh(cls.folder / "block.msh", cls.points, cls.tetrahedra)
        # The scene puts the surface point above the middle of the mesh's box at the origin.
        middle = 0.5 * (cls.points.min(axis=0) + cls.points.max(axis=0))
        cls.origin = np.array([middle[0], middle[1], cls.points[:, 2].max()])

    @classmethod
    def tearDownClass(cls):
        cls.temporary.cleanup()

    def forcegrid(self, model, contact, tool):
        scene = self.folder / f"{model}.toml"
        scene.write_text(f"""\
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
        command = [PROGRAM, "--no-config", "scene", os.fspath(scene),
                   "--force-at", ",".join(map(repr, tool.tolist())),
                   "--contact", ",".join(map(repr, (contact - self.origin).tolist())),
                   "--json", "--displacements"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 0, done.stderr)
        found = json.loads(done.stdout)
        self.assertTrue(found["converged"])
        return np.array(found["force_N"]), np.array(found["displacements_m"])

    def compare(self, model, expected):
        """`expected`: force [N] and displacements [m] of each of the peer's answers."""
        worst_force, worst_place = 0.0, 0.0
        for (contact, tool), (peer_force, peer_displacements) in zip(
                self.cases.places, expected, strict=True):
            force, displacements = self.forcegrid(model, contact, tool)
            worst_force = max(worst_force,
                              np.linalg.norm(force - peer_force) / np.linalg.norm(peer_force))
            worst_place = max(worst_place, np.abs(displacements - peer_displacements).max()
                              / np.linalg.norm(tool))
        print(f"{model}: {len(self.cases.places)} positions, force within {worst_force:.1e}, "
              f"displacements within {worst_place:.1e} of the tool's")
        self.assertLess(worst_force, TOLERANCE)
        self.assertLess(worst_place, TOLERANCE)

    def solved(self, make_peer):
        """The answers of a peer of this process, which `make_peer` makes for a contact."""
        for contact, tool in self.cases.places:
            peer = make_peer(contact)
            force = peer.solve(tool)
            yield force, peer.displacement.reshape(-1, 3)


@unittest.skipIf(getfem is None, "no module getfem; setup/install.sh fem installs it")
class GetFemPeer(Comparison):
    def solved_with(self, expression):
        return self.solved(lambda contact: GetFem(self.points, self.tetrahedra, contact,
                                                  expression))

    def test_stvk_is_getfems(self):
        self.compare("stvk", self.solved_with(
            "((Id(3)+Grad_u)*Saint_Venant_Kirchhoff_PK2(Grad_u,[la;mu])):Grad_Test_u"))

    def test_neo_hookean_is_what_getfem_makes_of_its_energy(self):
        m, stiff = "(4*mu/3)", "(la+5*mu/6)"
        self.compare("neo_hookean", self.solved_with(
            f"{m}/2*(Norm_sqr(Id(3)+Grad_u)-3)"
            f"+{stiff}/2*sqr(Det(Id(3)+Grad_u)-1-3*{m}/(4*{stiff}))"
            f"-{m}/2*log(Norm_sqr(Id(3)+Grad_u)+1)"))


@unittest.skipIf(FREEFEM is None, "no program FreeFem++-nw; setup/install.sh fem installs it")
class FreeFemPeer(Comparison):
    def test_stvk_is_what_freefem_solves(self):
        self.compare("stvk", solve_with_freefem(self.folder, "stvk", self.cases))

    def test_neo_hookean_is_what_freefem_solves(self):
        self.compare("neo_hookean", solve_with_freefem(self.folder, "neo_hookean", self.cases))


class SciPyPeer(Comparison):
    def test_corotated_is_the_minimum_that_scipy_finds(self):
        self.compare("corotated", self.solved(
            lambda contact: Corotated(self.points, self.tetrahedra, contact)))


if __name__ == "__main__":
    result = unittest.main(verbosity=2, exit=False).result
    if result.wasSuccessful() and result.testsRun == len(result.skipped):
        sys.exit(SKIPPED)
    sys.exit(not result.wasSuccessful())
