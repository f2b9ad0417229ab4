// SPDX-License-Identifier: Apache-2.0
// A plane that opens the objects, so that their inside is seen: what is nearer than it is left out.
// It is upright, faces the person, and goes through the tool.

import * as THREE from '/three.module.js';

const kUpright = 0.05;  // below this share of the view's direction, the plane keeps its last one

/** For a vertex shader that has `vec3 at_W_m`, before and in its main(). */
export const kSectionVertexHead = `
  #ifdef SECTION
  uniform vec4 section;
  varying float ahead_m;
  #endif`;
export const kSectionVertex = `
  #ifdef SECTION
  ahead_m = dot(section.xyz, at_W_m) - section.w;
  #endif`;
/** The same for a fragment shader. */
export const kSectionFragmentHead = `
  #ifdef SECTION
  varying float ahead_m;
  #endif`;
export const kSectionFragment = `
  #ifdef SECTION
  if (ahead_m > 0.0) { discard; }
  #endif`;

/** For lines with a frame's quantised vertices, a little nearer than what they lie on. */
export const kLineVertexShader = `
  uniform mat4 to_picture;
  uniform vec3 low;
  uniform vec3 grain;
  ${kSectionVertexHead}
  void main() {
    vec3 at_W_m = low + grain * position;
    ${kSectionVertex}
    gl_Position = to_picture * vec4(position, 1.0);
    gl_Position.z -= 0.0004 * gl_Position.w;
  }`;

export class Section {
  constructor() {
    this.active = false;
    this.uniform = {value: new THREE.Vector4(1, 0, 0, 0)};  // its normal, and that times a point
  }

  /** Makes the shaders of a material obey the plane, or not. */
  apply(material) {
    material.defines = this.active ? {SECTION: 1} : {};
    material.needsUpdate = true;
  }

  /** @param tool_W_m or null; box of the objects, through whose middle it goes without a tool. */
  place(camera, tool_W_m, box) {
    const {x, y, z} = camera.getWorldDirection(new THREE.Vector3());
    if (Math.hypot(x, y) > kUpright * Math.hypot(x, y, z)) {
      const length = Math.hypot(x, y);
      this.uniform.value.set(-x / length, -y / length, 0, 0);
    }
    const beside = tool_W_m === null || tool_W_m.x < box.min.x || tool_W_m.x > box.max.x ||
        tool_W_m.y < box.min.y || tool_W_m.y > box.max.y;
    const at = beside ? box.getCenter(new THREE.Vector3()) : tool_W_m;
    const normal = this.uniform.value;
    normal.w = normal.x * at.x + normal.y * at.y;
  }
}
