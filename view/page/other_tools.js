// SPDX-License-Identifier: Apache-2.0
// The arms and tools that hold the object beside the one whose scope is shown.

import * as THREE from '/three.module.js';
import {Arm, Arrow, Tool} from '/parts.js';

const kArmOpacity = 0.5;
const kArmThickness = 0.018;   // of the object's radius, as the forces
const kArrowThickness = 0.012;
const kFirstOrder = 20;        // of drawing, after the arrows of the shown tool

export class OtherTools {
  constructor() {
    this.group = new THREE.Group();
    this.parts = new Map();  // by the tool's place
    this.palette = null;
  }

  part(tool) {
    let part = this.parts.get(tool);
    if (!part) {
      part = {arm: new Arm(), tool: new Tool(), arrow: new Arrow(kFirstOrder + tool),
              at_W_m: null, at: new THREE.Vector3(), force_W_N: [NaN, NaN, NaN],
              in_contact: false};
      part.arm.material.transparent = true;
      part.arm.material.opacity = kArmOpacity;
      this.parts.set(tool, part);
      this.group.add(part.arm.group, part.tool.group, part.arrow.group);
      this.colour(part);
    }
    return part;
  }

  set_arm(message, radius_m) {
    this.part(message.tool).arm.update(message.lines, radius_m * kArmThickness);
  }

  set_place(message) {
    Object.assign(this.part(message.tool), {at_W_m: message.position_W_m,
                                            force_W_N: message.force_W_N,
                                            in_contact: message.in_contact});
  }

  /** Keeps these tools alone. @param tools a Set of their places. */
  keep(tools) {
    [...this.parts].filter(([tool]) => !tools.has(tool)).forEach(([tool, part]) => {
      this.group.remove(part.arm.group, part.tool.group, part.arrow.group);
      this.parts.delete(tool);
    });
  }

  /**
   * Places what is drawn.
   * @param shown {arm, forces}: layers. @param sizes {radius_m, tool_radius_m, metres_per_N}.
   */
  update(shown, sizes, camera) {
    for (const part of this.parts.values()) {
      part.arm.group.visible = shown.arm;
      part.tool.group.visible = part.at_W_m !== null;
      part.arrow.group.visible = false;
      if (part.at_W_m === null) {
        continue;
      }
      part.at.set(...part.at_W_m);
      part.tool.update(part.at, null, part.in_contact, sizes.tool_radius_m, camera);
      if (shown.forces) {
        part.arrow.update(part.at, part.force_W_N, sizes.metres_per_N,
                          sizes.radius_m * kArrowThickness);
      }
    }
  }

  set_theme(palette) {
    this.palette = palette;
    this.parts.forEach((part) => this.colour(part));
  }

  colour(part) {
    if (this.palette) {
      part.arm.material.color.set(this.palette.arm);
      part.tool.set_theme(this.palette);
      part.arrow.material.color.set(this.palette.commanded);
    }
  }
}
