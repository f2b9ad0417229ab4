// SPDX-License-Identifier: Apache-2.0
// A slice through a method's force field: a square that follows the tool, coloured by what the
// method would answer there. Where it knows nothing the square is hatched.

import * as THREE from '/three.module.js';
import {Directions} from '/directions.js';

const kKnown = 0;          // numbers of hello.statuses
const kPartlyKnown = 1;
const kValuesPerPoint = 5;
const kContours = 8;       // between zero and the end of the colours' range
const kShrink = 0.9;       // of the range, for each slice that needs less

const kVertexShader = `
  attribute vec2 cell;
  varying vec2 place;
  varying vec2 at_cell;
  void main() {
    place = uv;
    at_cell = cell;
    gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
  }`;

const kFragmentShader = `
  uniform sampler2D field;
  uniform vec3 ramp[4];
  uniform float contours;
  uniform float cells;  // 1: draws the grid's
  varying vec2 place;
  varying vec2 at_cell;
  void main() {
    vec4 point = texture2D(field, place);
    vec2 edge = abs(fract(at_cell - 0.5) - 0.5) / max(fwidth(at_cell), vec2(1e-4));
    if (cells > 0.5 && min(edge.x, edge.y) < 0.6) {
      gl_FragColor = vec4(ramp[0] * 0.5, 0.8);
      return;
    }
    if (point.g < 0.25) {  // unknown
      float stripe = fract((gl_FragCoord.x + gl_FragCoord.y) / 9.0);
      gl_FragColor = vec4(ramp[0], stripe < 0.25 ? 0.45 : 0.12);
      return;
    }
    float height = point.r * 3.0;
    vec3 colour = mix(ramp[0], ramp[1], min(height, 1.0));
    colour = mix(colour, ramp[2], clamp(height - 1.0, 0.0, 1.0));
    colour = mix(colour, ramp[3], max(height - 2.0, 0.0));
    float level = point.r * contours;
    float line = abs(fract(level + 0.5) - 0.5) / max(fwidth(level), 1e-4);
    colour = mix(colour * 0.55, colour, clamp(line, 0.0, 1.0));
    gl_FragColor = vec4(colour, point.g < 0.75 ? 0.55 : 0.85);  // partly known, known
  }`;

/** What a person may colour the slice by. */
export const kQuantities = {
  force: {word: 'force', unit: 'N', of: (v, i) => Math.hypot(v[i], v[i + 1], v[i + 2])},
  x: {word: '|force x|', unit: 'N', of: (v, i) => Math.abs(v[i])},
  y: {word: '|force y|', unit: 'N', of: (v, i) => Math.abs(v[i + 1])},
  z: {word: '|force z|', unit: 'N', of: (v, i) => Math.abs(v[i + 2])},
  uncertainty: {word: 'uncertainty', unit: 'N', of: (v, i) => v[i + 3]},
};

export class Field {
  constructor() {
    this.points = 0;
    this.quantity = 'force';
    this.top_N = 0;  // end of the colours' range
    this.largest_N = Infinity;  // that the range may grow to: what the device can render
    this.message = null;
    this.uniforms = {
      field: {value: null},
      contours: {value: kContours},
      cells: {value: 0},
      ramp: {value: [0, 1, 2, 3].map(() => new THREE.Color(0x808080))},
    };
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(new Float32Array(12), 3));
    geometry.setAttribute('uv', new THREE.BufferAttribute(new Float32Array(8), 2));
    geometry.setAttribute('cell', new THREE.BufferAttribute(new Float32Array(8), 2));
    geometry.setIndex([0, 1, 3, 0, 3, 2]);
    this.grid = null;  // of the methods: {low_W_m, high_W_m, cells}
    this.mesh = new THREE.Mesh(geometry, new THREE.ShaderMaterial({
      uniforms: this.uniforms, vertexShader: kVertexShader, fragmentShader: kFragmentShader,
      side: THREE.DoubleSide, transparent: true, depthWrite: false,
      extensions: {derivatives: true},
    }));
    this.mesh.frustumCulled = false;
    this.mesh.renderOrder = 5;
    this.mesh.visible = false;
    this.directions = new Directions();
  }

  hide() {
    this.mesh.visible = false;
    this.directions.hide();
    this.message = null;
    this.top_N = 0;
  }

  set_theme(palette) {
    palette.ramp.forEach((colour, i) => this.uniforms.ramp.value[i].set(colour));
    this.directions.set_theme(palette);
  }

  show_cells(shown) {
    this.uniforms.cells.value = shown && this.grid ? 1 : 0;
  }

  set_quantity(quantity) {
    this.quantity = quantity;
    this.top_N = 0;
    if (this.message) {
      this.show(this.message);
    }
  }

  /** Shows a decoded slice. */
  show(message) {
    this.message = message;
    this.place(message);
    this.colour(message);
    this.directions.show(message);
    this.mesh.visible = true;
  }

  place({points, corner, across, along}) {
    const {position, uv, cell} = this.mesh.geometry.attributes;
    const axes = [across, along].map((way) => way.findIndex((value) => value !== 0));
    const inset = 0.5 / points;  // a texel's middle stands for its point
    [[0, 0], [1, 0], [0, 1], [1, 1]].forEach(([u, v], i) => {
      const at = (axis) => corner[axis] + (points - 1) * (u * across[axis] + v * along[axis]);
      position.setXYZ(i, at(0), at(1), at(2));
      uv.setXY(i, u ? 1 - inset : inset, v ? 1 - inset : inset);
      if (this.grid) {
        const {low_W_m, high_W_m, cells} = this.grid;
        cell.setXY(i, ...axes.map((axis) => (at(axis) - low_W_m[axis]) * cells[axis] /
                                            (high_W_m[axis] - low_W_m[axis])));
      }
    });
    cell.needsUpdate = true;
    position.needsUpdate = true;
    uv.needsUpdate = true;
  }

  colour({points, values}) {
    const count = points * points;
    if (points !== this.points) {
      this.points = points;
      if (this.uniforms.field.value) {
        this.uniforms.field.value.dispose();
      }
      const texture = new THREE.DataTexture(new Uint8Array(4 * count), points, points,
                                            THREE.RGBAFormat);
      texture.magFilter = THREE.LinearFilter;
      texture.minFilter = THREE.LinearFilter;
      this.uniforms.field.value = texture;
    }
    const {of} = kQuantities[this.quantity];
    const shown = new Float32Array(count);
    let largest = 0;
    for (let i = 0; i < count; ++i) {
      const status = values[kValuesPerPoint * i + 4];
      const value = of(values, kValuesPerPoint * i);
      const known = (status === kKnown || status === kPartlyKnown) && Number.isFinite(value);
      shown[i] = known ? value : NaN;
      largest = known ? Math.max(largest, value) : largest;
    }
    // The range grows at once and shrinks slowly, so that colours do not flicker.
    this.top_N = Math.min(Math.max(largest, kShrink * this.top_N, 1e-6), this.largest_N);
    const data = this.uniforms.field.value.image.data;
    for (let i = 0; i < count; ++i) {
      const known = !Number.isNaN(shown[i]);
      data[4 * i] = known ? Math.min(255, Math.round(255 * shown[i] / this.top_N)) : 0;
      data[4 * i + 1] = !known ? 0 : values[kValuesPerPoint * i + 4] === kKnown ? 255 : 128;
      data[4 * i + 3] = 255;
    }
    this.uniforms.field.value.needsUpdate = true;
  }

  /** Shares of the points [0, 1] that are known, partly known and unknown; for tests and words. */
  shares() {
    const count = this.points * this.points;
    const data = this.uniforms.field.value ? this.uniforms.field.value.image.data : [];
    const share = {known: 0, partly: 0, unknown: 0};
    for (let i = 0; i < count; ++i) {
      const green = data[4 * i + 1];
      share[green === 255 ? 'known' : green === 128 ? 'partly' : 'unknown'] += 1 / count;
    }
    return share;
  }
}
