#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes what a device's own processor needs of a profile as a C++ header.
usage: make_profile.py PROFILE.toml HEADER.h"""
import pathlib
import sys
import tomllib

# Tables of profiles::DeviceProfile and their members, in its order.
MEMBERS = {
    "kinematics": ("link_length_m", "origin_m", "capstan_diameter_m", "body_diameter_m",
                   "encoder_counts_per_turn", "encoder_sign", "linkage_sign", "linkage_offset_rad",
                   "joint_min_rad", "joint_max_rad", "elbow_min_rad", "elbow_max_rad"),
    "motors": ("torque_constant_Nm_per_A", "max_current_A"),
    "gravity": ("acceleration_m_per_s2", "link_b_mass_kg", "link_c_mass_kg", "link_b_center_m",
                "link_c_center_m"),
    "limits": ("max_force_N", "workspace_min_m", "workspace_max_m"),
}


def literal(value):
    if isinstance(value, list):
        return "{" + ", ".join(literal(v) for v in value) + "}"
    return repr(float(value))


def header_of(profile):
    if profile.get("kind", "arm") != "arm":
        raise SystemExit("make_profile.py: %s is no arm" % profile["name"])
    lines = ["// Made of profiles/%s.toml by firmware/make_profile.py." % profile["name"],
             "#pragma once", "", '#include "profiles/device_profile.h"', "",
             "namespace forcegrid::firmware {", ""]
    for table, members in MEMBERS.items():
        lines.append("inline constexpr profiles::DeviceProfile::%s k%s = {" %
                     (table.capitalize(), table.capitalize()))
        lines += ["    .%s = %s," % (name, literal(profile[table][name])) for name in members]
        lines += ["};", ""]
    return "\n".join(lines + ["}  // namespace forcegrid::firmware", ""])


if __name__ == "__main__":
    if len(sys.argv) != 3:
        raise SystemExit(__doc__)
    with open(sys.argv[1], "rb") as file:
        text = header_of(tomllib.load(file))
    pathlib.Path(sys.argv[2]).write_text(text, encoding="utf-8")
