// SPDX-License-Identifier: Apache-2.0
// The blocks of storage that the methods have in use, as the edges of boxes. They have the colours
// of their methods' arrows. What is inside the object shines through it: forces are felt there.

import * as THREE from '/three.module.js';

const kCorners = [0, 1, 2, 3, 4, 5, 6, 7];
// Pairs of corners that differ in one axis; bit i of a corner says which end of axis i it is at.
const kEdges = kCorners.flatMap((a) => [1, 2, 4].filter((bit) => (a & bit) === 0)
    .map((bit) => [a, a | bit])).flat();
export const kValuesPerBlock = 7;  // a message's: method, low and high corner

function edges(options) {
  const lines = new THREE.LineSegments(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({
    vertexColors: THREE.VertexColors, transparent: true, depthWrite: false, ...options}));
  lines.frustumCulled = false;
  return lines;
}

export class Blocks {
  constructor() {
    this.methods = new Uint32Array(0);  // of each block
    this.in_use = null;                 // all of them, also those that were not sent
    this.colours = [];
    this.lines = edges({opacity: 0.6});
    this.lines.visible = false;
    this.behind = edges({opacity: 0.2, depthTest: false});
    this.lines.add(this.behind);
  }

  /** Shows the blocks of a message of decode.js; null: none are known. */
  show(message) {
    const boxes = message ? message.count : 0;
    this.in_use = message ? message.in_use : null;
    this.methods = new Uint32Array(boxes);
    const ends = new Float32Array(3 * kEdges.length * boxes);
    for (let box = 0, to = 0; box < boxes; ++box) {
      const from = kValuesPerBlock * box;
      this.methods[box] = message.methods[from];
      for (const corner of kEdges) {
        for (let axis = 0; axis < 3; ++axis) {
          ends[to++] = message.values[from + 1 + axis + 3 * (corner >> axis & 1)];
        }
      }
    }
    this.lines.geometry.dispose();
    this.lines.geometry = this.behind.geometry = new THREE.BufferGeometry();
    this.lines.geometry.setAttribute('position', new THREE.BufferAttribute(ends, 3));
    this.lines.visible = boxes > 0;
    this.paint();
  }

  paint() {
    const colours = new Float32Array(3 * kEdges.length * this.methods.length);
    this.methods.forEach((method, box) => {
      const colour = this.colours[method % this.colours.length];
      for (let end = kEdges.length * box; colour && end < kEdges.length * (box + 1); ++end) {
        colours.set([colour.r, colour.g, colour.b], 3 * end);
      }
    });
    this.lines.geometry.setAttribute('color', new THREE.BufferAttribute(colours, 3));
  }

  set_theme(palette) {
    this.colours = palette.series.map((colour) => new THREE.Color(colour));
    this.paint();
  }
}
