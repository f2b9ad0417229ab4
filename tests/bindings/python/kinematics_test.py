#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""forcegrid.Kinematics against the worked examples of the device sheets and against itself."""
import unittest

import numpy as np

import forcegrid

PRINTED = 1e-12  # the sheets print 12 decimals
PRINTED_COUNTS = 1e-6
ARMS = ("woodenhaptics_v2015", "woodenhaptics_v2019", "polhem_v1", "vintage", "phantom_desktop",
        "phantom_desktop_wrist")

# profile, counts, joint angles [rad], position in D [m]: as tests/driver/kinematics_test.cpp has them.
FORWARD = (
    ("woodenhaptics_v2015", (1000, 2000, 6500), (0.196349540849, 0.523598775598, 1.701696020694),
     (0.118767150201, 0.067384975837, 0.209514124870)),
    ("woodenhaptics_v2015", (-2500, 3500, 5000), (-0.490873852123, 0.916297857297, 1.308996938996),
     (0.132141690961, -0.188223655251, 0.061385426897)),
    ("polhem_v1", (1200, -1500, -5600), (-0.209439510239, 0.471238898038, 1.759291886010),
     (0.065057445977, -0.043586305662, 0.137956850049)),
    ("vintage", (2500, -1000, 10500), (0.436332312999, -0.203999522960, 2.141994991084),
     (-0.079945040247, 0.028004087643, 0.251690225464)),
    ("phantom_desktop", (2000, -1500, 1200), (0.340884619530, -0.255663464648, 0.204530771718),
     (0.033767867969, 0.052187489339, -0.050943035351)),
)
INVERSE = (
    ("woodenhaptics_v2015", (0.05, -0.03, 0.02), (-0.110657221174, 0.453822576025, 0.836040572288),
     (-563.572600, 1733.474550, 3193.439753)),
    ("phantom_desktop", (0.06, -0.08, 0.06), (-0.432371193105, 0.460346448950, 0.565476260226),
     (-2536.759762, 2700.893045, 3317.698880)),
)


def near(actual, expected, tolerance):
    np.testing.assert_allclose(actual, expected, rtol=0, atol=tolerance)


class Arms(unittest.TestCase):
    def test_reproduce_the_sheets_forward_examples(self):
        for profile, counts, angles, position in FORWARD:
            with self.subTest(profile=profile, counts=counts):
                pose = forcegrid.Kinematics(profile).forward(counts)
                self.assertIs(pose.status, forcegrid.KinematicsStatus.OK)
                near(pose.joint_angle_rad, angles, PRINTED)
                near(pose.position_D_m, position, PRINTED)

    def test_reproduce_the_sheets_inverse_examples(self):
        for profile, position, angles, counts in INVERSE:
            with self.subTest(profile=profile):
                inverse = forcegrid.Kinematics(profile).inverse(position)
                self.assertIs(inverse.status, forcegrid.KinematicsStatus.OK)
                near(inverse.joint_angle_rad, angles, PRINTED)
                near(inverse.counts, counts, PRINTED_COUNTS)

    def test_reproduce_the_sheets_jacobian_and_torque(self):
        pose = forcegrid.Kinematics("woodenhaptics_v2015").forward((1000, 2000, 6500))
        near(pose.jacobian_D_m_per_rad,
             [[-0.067384975837, 0.174123918540, -0.031364451169],
              [0.338767150201, 0.034635400854, -0.006238777234],
              [0.0, -0.102500000000, 0.242903991037]], PRINTED)
        near(pose.jacobian_D_m_per_rad.T @ (1, -2, 0.5),
             (-0.744919276239, 0.053603116831, 0.102565098817), PRINTED)

    def test_have_a_jacobian_that_equals_central_differences(self):
        step = 1e-5
        for profile in ARMS + ("falcon",):
            with self.subTest(profile=profile):
                arm = forcegrid.Kinematics(profile)
                q = arm.inverse((0.01, -0.02, 0.015)).joint_angle_rad
                differences = [(arm.forward_from_angles(q + dq).position_D_m
                                - arm.forward_from_angles(q - dq).position_D_m) / (2 * step)
                               for dq in step * np.eye(3)]
                # Third derivative * step^2, and rounding / step.
                near(arm.jacobian(q), np.transpose(differences), 1e-8)

    def test_undo_the_inverse_over_the_workspace_in_bulk_and_one_by_one(self):
        random = np.random.default_rng(20)
        for profile in ARMS + ("falcon",):
            with self.subTest(profile=profile):
                arm = forcegrid.Kinematics(profile)
                low, high = 0.5 * arm.profile.workspace_D_m
                positions = random.uniform(low, high, (50, 3))
                inverse = arm.inverse(positions)
                self.assertTrue((inverse.status == forcegrid.KinematicsStatus.OK).all())
                poses = arm.forward(inverse.counts)
                self.assertEqual(poses.jacobian_D_m_per_rad.shape, (50, 3, 3))
                near(poses.position_D_m, positions, 1e-11)
                for i in range(0, 50, 7):
                    one = arm.forward(inverse.counts[i])
                    np.testing.assert_array_equal(one.position_D_m, poses.position_D_m[i])
                    np.testing.assert_array_equal(one.jacobian_D_m_per_rad,
                                                  poses.jacobian_D_m_per_rad[i])
                    np.testing.assert_array_equal(arm.inverse(positions[i]).counts,
                                                  inverse.counts[i])


class Falcon(unittest.TestCase):
    # From the sheet, in its base frame B; D is (z, x, y) of B from the centre.
    COUNTS, POSITION_B = (-300, -650, -420), np.array((0.008943261911, -0.006036252787, 0.112189283513))

    def test_is_in_the_device_frame(self):
        falcon = forcegrid.Kinematics("falcon")
        pose = falcon.forward(self.COUNTS)
        straight = falcon.forward((0, 0, 0))  # (0, 0, 0.134602428444) in B
        near(pose.position_D_m - straight.position_D_m,
             self.POSITION_B[[2, 0, 1]] - (0.134602428444, 0, 0), 3e-12)
        near(falcon.inverse(pose.position_D_m).counts, self.COUNTS, 1e-7)
        self.assertEqual(falcon.profile.kind, "delta")
        near(falcon.gravity_torque(pose.joint_angle_rad), (0, 0, 0), 0)


class Bad(unittest.TestCase):
    def test_input_is_named(self):
        arm = forcegrid.Kinematics("vintage")
        with self.assertRaisesRegex(ValueError, r"counts: expected shape \(3,\) or \(n, 3\), got \(4,\)"):
            arm.forward((1, 2, 3, 4))
        with self.assertRaisesRegex(ValueError, "position_D_m: expected numbers"):
            arm.inverse("here")
        with self.assertRaisesRegex(forcegrid.ProfileError, "vintag.*vintage"):
            forcegrid.Kinematics("vintag")

    def test_poses_have_a_status_and_no_position(self):
        arm = forcegrid.Kinematics("woodenhaptics_v2015")
        inverse = arm.inverse([(9.0, 0, 0), (0, 0, 0), (np.nan, 0, 0)])
        self.assertEqual(list(inverse.status), [forcegrid.KinematicsStatus.UNREACHABLE,
                                                forcegrid.KinematicsStatus.OK,
                                                forcegrid.KinematicsStatus.NOT_FINITE])
        self.assertTrue(np.isnan(inverse.counts[[0, 2]]).all())
        self.assertTrue(np.isfinite(inverse.counts[1]).all())

    def test_profiles_are_listed(self):
        self.assertLessEqual({*ARMS, "falcon"}, set(forcegrid.profile_names()))
        profile = forcegrid.load_profile("phantom_desktop")
        self.assertEqual((profile.name, profile.kind), ("phantom_desktop", "arm"))
        self.assertGreater(profile.max_force_N, 1.0)


if __name__ == "__main__":
    unittest.main()
