// SPDX-License-Identifier: Apache-2.0
// Where the forces of a slice point: strokes from some of its points, as long as the force is large.

import * as THREE from '/three.module.js';

const kEvery = 4;         // points from one stroke to the next
const kLongest = 0.9;     // of the way to the next stroke
const kShortest = 0.02;   // of the largest force: less has no stroke
const kValuesPerPoint = 5;
const kUnknown = 2;       // the first of hello.statuses without a force

export class Directions {
  constructor() {
    this.strokes = [];  // of each its two ends in W [m], six numbers; the force points to the second
    this.wanted = true;
    this.lines = new THREE.LineSegments(
        new THREE.BufferGeometry(),
        new THREE.LineBasicMaterial({vertexColors: THREE.VertexColors}));
    this.lines.frustumCulled = false;
    this.lines.renderOrder = 6;  // on the slice
    this.lines.visible = false;
    this.colours = [new THREE.Color(), new THREE.Color()];
  }

  set_theme(palette) {
    this.colours[0].set(palette.backdrop);
    this.colours[1].set(palette.text);
    this.paint();
  }

  set_wanted(wanted) {
    this.wanted = wanted;
    this.lines.visible = wanted && this.strokes.length > 0;
  }

  hide() {
    this.strokes = [];
    this.lines.visible = false;
  }

  /** Shows those of a decoded slice. */
  show({points, corner, across, along, values}) {
    const at = [];
    let largest_N = 0;
    for (let row = 0; row < points; row += kEvery) {
      for (let column = 0; column < points; column += kEvery) {
        const first = kValuesPerPoint * (row * points + column);
        const force_N = Math.hypot(values[first], values[first + 1], values[first + 2]);
        if (values[first + 4] < kUnknown && force_N > 0) {
          at.push({row, column, first, force_N});
          largest_N = Math.max(largest_N, force_N);
        }
      }
    }
    const longest_m = kLongest * kEvery * Math.hypot(...across);
    this.strokes = at.filter(({force_N}) => force_N > kShortest * largest_N)
        .map(({row, column, first}) => {
          const foot = corner.map((low, axis) => low + column * across[axis] + row * along[axis]);
          const tip = foot.map((place, axis) =>
              place + longest_m * values[first + axis] / largest_N);
          return [...foot, ...tip];
        });
    this.lines.geometry.dispose();
    this.lines.geometry = new THREE.BufferGeometry();
    this.lines.geometry.setAttribute(
        'position', new THREE.BufferAttribute(new Float32Array(this.strokes.flat()), 3));
    this.paint();
    this.set_wanted(this.wanted);
  }

  /** A stroke goes from the backdrop's colour to the text's. */
  paint() {
    const colours = new Float32Array(6 * this.strokes.length);
    this.strokes.forEach((_, i) => this.colours.forEach((colour, end) => {
      colour.toArray(colours, 6 * i + 3 * end);
    }));
    this.lines.geometry.setAttribute('color', new THREE.BufferAttribute(colours, 3));
  }
}
