// SPDX-License-Identifier: Apache-2.0
// The springs inside an object, or the edges of its tetrahedra, as lines that move with their
// vertices. Those at the section are strong; behind it they fade, and end after some two layers. So
// a hundred thousand can be told apart, and drawn by software.

import * as THREE from '/three.module.js';
import {Section, kLineVertexShader, kSectionFragment, kSectionFragmentHead} from '/section.js';

const kStrength = 0.55;
const kFade = 0.5;  // of an edge's mean length: the distance behind the section that halves a line
const kDepth = 4;   // such distances: what is farther behind is not drawn

const kFragmentShader = `
  uniform vec3 tint;
  uniform float fade_m;
  ${kSectionFragmentHead}
  void main() {
    ${kSectionFragment}
    float strength = ${kStrength};
    #ifdef SECTION
    strength *= exp2(ahead_m / fade_m);
    #endif
    gl_FragColor = vec4(tint, strength);
  }`;

/** Transformation from a message's 16-bit numbers to the picture. */
export function set_to_picture(matrix, low, grain, camera) {
  const scaled = new THREE.Matrix4().makeScale(grain.x, grain.y, grain.z).setPosition(low);
  matrix.multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse).multiply(scaled);
}

class Inside {
  /** @param message the lines of decode.js. @param section the plane that opens the object. */
  constructor(message, section) {
    const {epoch, vertices, springs, element_edges} = message;
    Object.assign(this, {epoch, vertices, springs, element_edges});
    this.ends = message.ends;
    this.frames = 0;
    this.near = new THREE.BufferAttribute(new Uint32Array(this.ends.length), 1);
    this.near.setUsage(THREE.DynamicDrawUsage);
    this.selected_for = '';  // the plane and the frame that `near` was made for
    this.ahead_m = new Float32Array(vertices);
    this.positions = new Uint16Array(3 * vertices);
    this.attribute = new THREE.BufferAttribute(this.positions, 3);
    this.attribute.setUsage(THREE.DynamicDrawUsage);
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', this.attribute);
    geometry.setIndex(this.near);
    geometry.setDrawRange(0, 0);
    this.uniforms = {
      to_picture: {value: new THREE.Matrix4()}, low: {value: new THREE.Vector3()},
      grain: {value: new THREE.Vector3()}, tint: {value: new THREE.Color(0xffffff)},
      fade_m: {value: 0.01}, section: section.uniform,
    };
    this.lines = new THREE.LineSegments(geometry, new THREE.ShaderMaterial({
      uniforms: this.uniforms, vertexShader: kLineVertexShader, fragmentShader: kFragmentShader,
      transparent: true, depthWrite: false}));
    section.apply(this.lines.material);
    this.lines.frustumCulled = false;  // the box of its 16-bit numbers is not the object's
    this.lines.visible = false;        // until its first frame
    this.lines.onBeforeRender = (renderer, scene, camera) => set_to_picture(
        this.uniforms.to_picture.value, this.uniforms.low.value, this.uniforms.grain.value, camera);
  }

  /** Edges whose places are known; none if the object has too many. */
  get edges() {
    return this.lines.visible ? this.ends.length / 2 : 0;
  }

  /** Of them, at the section or near behind it: they are drawn. */
  get drawn() {
    return this.lines.geometry.drawRange.count / 2;
  }

  /** The object has edges, but too many to be sent. */
  get is_too_large() {
    return this.ends.length === 0 && this.springs + this.element_edges > 0;
  }

  /** Shows a frame; false for one of another epoch or size. */
  update(frame) {
    if (frame.epoch !== this.epoch || frame.vertices !== this.vertices) {
      return false;
    }
    this.positions.set(frame.values);
    this.attribute.needsUpdate = true;
    this.uniforms.low.value.set(...frame.low);
    this.uniforms.grain.value.set(...frame.step);
    this.lines.visible = this.ends.length > 0;
    if (this.frames === 0 && this.ends.length > 0) {
      this.uniforms.fade_m.value = kFade * this.length_m / this.edges;
    }
    this.frames += 1;
    return true;
  }

  /** Finds the edges that are drawn: of those nearer than the plane and of those far behind it none. */
  select() {
    const {x: nx, y: ny, w: offset} = this.uniforms.section.value;
    const key = [nx, ny, offset, this.frames].join();
    if (!this.lines.visible || key === this.selected_for) {
      return;
    }
    this.selected_for = key;
    const {positions, ahead_m, ends, near} = this;
    const {low, grain, fade_m} = this.uniforms;
    const begin_m = nx * low.value.x + ny * low.value.y - offset;
    const [gx, gy] = [nx * grain.value.x, ny * grain.value.y];
    for (let vertex = 0; vertex < ahead_m.length; ++vertex) {
      ahead_m[vertex] = begin_m + gx * positions[3 * vertex] + gy * positions[3 * vertex + 1];
    }
    const farthest_m = -kDepth * fade_m.value;
    let count = 0;
    for (let i = 0; i < ends.length; i += 2) {
      const [a, b] = [ahead_m[ends[i]], ahead_m[ends[i + 1]]];
      if ((a < 0 || b < 0) && (a > farthest_m || b > farthest_m)) {
        near.array[count] = ends[i];
        near.array[count + 1] = ends[i + 1];
        count += 2;
      }
    }
    near.updateRange.count = count;
    near.needsUpdate = count > 0;
    this.lines.geometry.setDrawRange(0, count);
  }

  /** Where a vertex is [m]. */
  position_W_m(vertex) {
    const {low, grain} = this.uniforms;
    const [lows, grains] = [low.value.toArray(), grain.value.toArray()];
    return lows.map((low_m, axis) => low_m + grains[axis] * this.positions[3 * vertex + axis]);
  }

  /** The sum of the edges' lengths [m]. */
  get length_m() {
    const {ends, positions} = this;
    const {x: gx, y: gy, z: gz} = this.uniforms.grain.value;
    let sum_m = 0;
    for (let i = 0; i < ends.length; i += 2) {
      const [a, b] = [3 * ends[i], 3 * ends[i + 1]];
      sum_m += Math.hypot((positions[a] - positions[b]) * gx,
                          (positions[a + 1] - positions[b + 1]) * gy,
                          (positions[a + 2] - positions[b + 2]) * gz);
    }
    return sum_m;
  }

  set_theme(palette) {
    this.uniforms.tint.value.set(palette.mesh);
  }

  dispose() {
    this.lines.geometry.dispose();
    this.lines.material.dispose();
  }
}

/** The insides of all objects. */
export class Insides {
  constructor() {
    this.section = new Section();
    this.group = new THREE.Group();
    this.objects = new Map();
    this.palette = null;
  }

  set_lines(message) {
    this.remove(message.object);
    const inside = new Inside(message, this.section);
    this.objects.set(message.object, inside);
    this.group.add(inside.lines);
    if (this.palette) {
      inside.set_theme(this.palette);
    }
  }

  /** False for a frame without lines. */
  set_frame(frame) {
    const inside = this.objects.get(frame.object);
    return inside !== undefined && inside.update(frame);
  }

  remove(object) {
    const inside = this.objects.get(object);
    if (inside) {
      this.objects.delete(object);
      this.group.remove(inside.lines);
      inside.dispose();
    }
  }

  clear() {
    [...this.objects.keys()].forEach((object) => this.remove(object));
  }

  /** The sum of a property of each. */
  sum(name) {
    return [...this.objects.values()].reduce((sum, inside) => sum + inside[name], 0);
  }

  /** Before a picture. @param tool_W_m or null. @param box of the objects. */
  place(camera, tool_W_m, box) {
    if (this.section.active) {
      this.section.place(camera, tool_W_m, box);
      this.objects.forEach((inside) => inside.select());
    }
  }

  set_theme(palette) {
    this.palette = palette;
    this.objects.forEach((inside) => inside.set_theme(palette));
  }
}
