# SPDX-License-Identifier: Apache-2.0
"""Forcegrid: feel a soft virtual object through a haptic arm, from Python.

    import forcegrid

    method = forcegrid.make("auto")              # a force method
    arm = forcegrid.Kinematics("vintage")        # the linkage of a device
    run = forcegrid.Recording("run.h5")          # every cycle of a run, as NumPy arrays
    link = forcegrid.SimulatorLink()             # a simulator's end of the link

Units are SI and stand in the names, as do frames: W is the workspace frame, D the device's; both
have x toward the user, y to the user's right, z up. docs/python.md explains all of it.
"""
from ._core import *  # noqa: F401,F403
from ._core import __version__ as __version__

# Written out: type checkers do not see what is computed.
__all__ = [
    "Device", "DeviceError", "DeviceInUseError", "Estimate", "ForceSample", "Health", "Inverse",
    "Kinematics", "KinematicsStatus", "LinkError", "Method", "News", "NoDeviceError", "Pose",
    "Profile", "ProfileError", "Query", "Recording", "RecordingError", "ServoLink",
    "SimulatorLink", "State", "Status", "SurfacePatch", "ToolState", "Trace", "TraceError",
    "evaluate", "load_profile", "make", "method_names", "profile_names", "read_trace",
]
