// SPDX-License-Identifier: Apache-2.0
// What is in the picture beside the surface: tool, arm, force arrows, samples, workspace.

import * as THREE from '/three.module.js';
import {kSampleValues} from '/decode.js';

const kUp = new THREE.Vector3(0, 0, 1);
const kSampleLife_s = 4;
const kMostSamples = 512;
const kMostLinks = 64;

/** A unit cylinder along z from 0 to 1. */
function unit_rod(sides) {
  const geometry = new THREE.CylinderBufferGeometry(1, 1, 1, sides, 1);
  geometry.rotateX(Math.PI / 2);
  geometry.translate(0, 0, 0.5);
  return geometry;
}

function unit_tip(sides) {
  const geometry = new THREE.ConeBufferGeometry(1, 1, sides, 1);
  geometry.rotateX(Math.PI / 2);
  geometry.translate(0, 0, 0.5);
  return geometry;
}

/** An arrow from a point along a force. Over everything else, so that no surface hides it. */
export class Arrow {
  constructor(order) {
    this.material = new THREE.MeshBasicMaterial({depthTest: false, transparent: true});
    this.rod = new THREE.Mesh(unit_rod(8), this.material);
    this.tip = new THREE.Mesh(unit_tip(12), this.material);
    this.rod.renderOrder = this.tip.renderOrder = order;
    this.group = new THREE.Group();
    this.group.add(this.rod, this.tip);
    this.direction = new THREE.Vector3();
  }

  /** Length is metres_per_N times the force; shorter than its tip, it is hidden. */
  update(from_W_m, force_W_N, metres_per_N, thickness_m) {
    this.direction.set(...force_W_N);
    const length = this.direction.length() * metres_per_N;
    const tip = Math.min(thickness_m * 5, length * 0.6);
    this.group.visible = Number.isFinite(length) && length > thickness_m;
    if (!this.group.visible) {
      return;
    }
    this.group.position.copy(from_W_m);
    this.group.quaternion.setFromUnitVectors(kUp, this.direction.normalize());
    this.rod.scale.set(thickness_m, thickness_m, length - tip);
    this.tip.scale.set(tip * 0.42, tip * 0.42, tip);
    this.tip.position.z = length - tip;
  }
}

/** The arm's links as rods with round joints. */
export class Arm {
  constructor() {
    this.group = new THREE.Group();
    this.material = new THREE.MeshLambertMaterial();
    this.rod = unit_rod(10);
    this.ball = new THREE.SphereBufferGeometry(1, 10, 8);
    this.links = [];
    this.direction = new THREE.Vector3();
  }

  update(lines, thickness_m) {
    let used = 0;
    for (const points of lines) {
      for (let i = 0; i + 5 < points.length && used < kMostLinks; i += 3) {
        this.place(this.link(used++), points, i, thickness_m);
      }
    }
    this.links.forEach((link, i) => { link.visible = i < used; });
  }

  link(number) {
    if (number >= this.links.length) {
      const link = new THREE.Group();
      link.add(new THREE.Mesh(this.rod, this.material), new THREE.Mesh(this.ball, this.material));
      this.links.push(link);
      this.group.add(link);
    }
    return this.links[number];
  }

  place(link, points, i, thickness_m) {
    this.direction.set(points[i + 3] - points[i], points[i + 4] - points[i + 1],
                       points[i + 5] - points[i + 2]);
    const length = this.direction.length() || 1e-9;
    link.position.set(points[i], points[i + 1], points[i + 2]);
    link.quaternion.setFromUnitVectors(kUp, this.direction.divideScalar(length));
    const [rod, ball] = link.children;
    rod.scale.set(thickness_m, thickness_m, length);
    ball.scale.setScalar(thickness_m * 1.5);
  }
}

const kSampleVertexShader = `
  attribute float born_s;
  attribute float flags;  // 1: in contact, 2: requested
  uniform float now_s;
  uniform float size_px;
  varying float fade;
  varying float touched;
  varying float requested;
  void main() {
    fade = clamp(1.0 - (now_s - born_s) / ${kSampleLife_s.toFixed(1)}, 0.0, 1.0);
    requested = step(1.5, flags);
    touched = flags - 2.0 * requested;
    gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
    gl_PointSize = fade > 0.0 ? size_px * (0.5 + 0.5 * fade) * (1.0 + 0.5 * requested) : 0.0;
  }`;

const kSampleFragmentShader = `
  uniform vec3 free_colour;
  uniform vec3 touch_colour;
  uniform vec3 asked_colour;
  varying float fade;
  varying float touched;
  varying float requested;
  void main() {
    float r = length(gl_PointCoord - vec2(0.5));
    if (r > 0.5 || fade <= 0.0 || (requested > 0.5 && r < 0.3)) discard;  // a ring: requested
    vec3 colour = mix(free_colour, touch_colour, touched);
    gl_FragColor = vec4(mix(colour, asked_colour, requested), fade * 0.9);
  }`;

/** The simulator's samples as dots that fade with their age. */
export class Samples {
  constructor() {
    const make = (size) => new THREE.BufferAttribute(new Float32Array(size * kMostSamples), size)
        .setUsage(THREE.DynamicDrawUsage);
    this.place = make(3);
    this.born = make(1);
    this.flags = make(1);
    this.contact_W_m = null;  // where the tool holds the object; of the newest sample on its path
    this.epoch = NaN;
    this.requested = 0;       // answers to requests that came
    this.born.array.fill(-1e6);
    this.next = 0;
    this.newest_s = -1e6;
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', this.place);
    geometry.setAttribute('born_s', this.born);
    geometry.setAttribute('flags', this.flags);
    this.uniforms = {
      now_s: {value: 0},
      size_px: {value: 7},
      free_colour: {value: new THREE.Color()},
      touch_colour: {value: new THREE.Color()},
      asked_colour: {value: new THREE.Color()}
    };
    this.points = new THREE.Points(geometry, new THREE.ShaderMaterial({
      uniforms: this.uniforms, vertexShader: kSampleVertexShader,
      fragmentShader: kSampleFragmentShader, transparent: true, depthTest: false,
      depthWrite: false}));
    this.points.frustumCulled = false;
    this.points.renderOrder = 2;
  }

  /**
   * Adds the samples of a message, at the page's time [s].
   * @param dated they are as old as they say, by the clock of a recording; else they came now.
   */
  add(message, now_s, dated) {
    for (let i = 0; i < message.count; ++i) {
      const from = kSampleValues * i;
      const flags = message.values[from + 7];
      const slot = this.next++ % kMostSamples;
      this.place.array.set(message.values.subarray(from, from + 3), 3 * slot);
      this.born.array[slot] = dated ? message.values[from + 6] : now_s;
      this.flags.array[slot] = flags;
      if (flags >= 2) {
        this.requested += 1;
      } else {
        this.contact_W_m = flags === 1 ? Array.from(message.values.subarray(from + 8, from + 11))
                                       : null;
        this.epoch = message.values[from + 11];
      }
    }
    this.newest_s = now_s;
    this.place.needsUpdate = this.born.needsUpdate = this.flags.needsUpdate = true;
  }

  clear() {
    this.born.array.fill(-1e6);
    this.born.needsUpdate = true;
    this.contact_W_m = null;
  }

  /** Is there a dot that still fades? */
  fading(now_s) {
    return now_s - this.newest_s < kSampleLife_s + 0.1;
  }
}

/** The twelve edges of a box and a grid on its floor. */
export function workspace_lines(low, high) {
  const points = [];
  const line = (a, b) => points.push(...a, ...b);
  const [x0, y0, z0] = low;
  const [x1, y1, z1] = high;
  for (const [a, b] of [[[x0, y0], [x1, y0]], [[x1, y0], [x1, y1]], [[x1, y1], [x0, y1]],
                        [[x0, y1], [x0, y0]]]) {
    line([...a, z0], [...b, z0]);
    line([...a, z1], [...b, z1]);
    line([...a, z0], [...a, z1]);
  }
  const edges = points.length;
  const spacing = Math.max(x1 - x0, y1 - y0) / 10;
  for (let x = x0 + spacing; x < x1 - spacing / 2; x += spacing) {
    line([x, y0, z0], [x, y1, z0]);
  }
  for (let y = y0 + spacing; y < y1 - spacing / 2; y += spacing) {
    line([x0, y, z0], [x1, y, z0]);
  }
  const group = new THREE.Group();
  for (const [part, opacity] of [[points.slice(0, edges), 0.5], [points.slice(edges), 0.22]]) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(Float32Array.from(part), 3));
    group.add(new THREE.LineSegments(geometry, new THREE.LineBasicMaterial(
        {transparent: true, opacity, depthWrite: false})));
  }
  return group;
}

/** The tool: a ball, a ring that faces the camera while it touches, and the hand's target. */
export class Tool {
  constructor() {
    this.ball = new THREE.Mesh(new THREE.SphereBufferGeometry(1, 24, 16),
                               new THREE.MeshLambertMaterial());
    this.ring = new THREE.Mesh(new THREE.RingBufferGeometry(1.55, 1.9, 40),
        new THREE.MeshBasicMaterial({transparent: true, opacity: 0.95, depthTest: false}));
    this.ring.renderOrder = 3;
    this.target = new THREE.Mesh(new THREE.RingBufferGeometry(0.9, 1.15, 32),
                                 new THREE.MeshBasicMaterial({depthTest: false}));
    this.target.renderOrder = 5;
    this.target.visible = false;
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(new Float32Array(6), 3));
    this.string = new THREE.Line(geometry, new THREE.LineBasicMaterial({depthTest: false}));
    this.string.frustumCulled = false;
    this.string.renderOrder = 5;
    this.string.visible = false;
    this.group = new THREE.Group();
    this.group.add(this.ball, this.ring, this.target, this.string);
  }

  update(at_W_m, target_W_m, in_contact, radius_m, camera) {
    this.ball.position.copy(at_W_m);
    this.ball.scale.setScalar(radius_m);
    this.ring.visible = in_contact;
    this.ring.position.copy(at_W_m);
    this.ring.quaternion.copy(camera.quaternion);
    this.ring.scale.setScalar(radius_m);
    this.target.visible = this.string.visible = target_W_m !== null;
    if (target_W_m) {
      this.target.position.copy(target_W_m);
      this.target.quaternion.copy(camera.quaternion);
      this.target.scale.setScalar(radius_m * 1.2);
      const ends = this.string.geometry.attributes.position;
      ends.setXYZ(0, at_W_m.x, at_W_m.y, at_W_m.z);
      ends.setXYZ(1, target_W_m.x, target_W_m.y, target_W_m.z);
      ends.needsUpdate = true;
    }
  }

  set_theme(palette) {
    this.ball.material.color.set(palette.tool);
    this.ring.material.color.set(palette.touch);
    this.target.material.color.set(palette.accent);
    this.string.material.color.set(palette.accent);
  }
}

/** Where the tool took hold of the object: a cross in the plane of the picture. */
export class ContactPoint {
  constructor() {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(
        new Float32Array([-1, 0, 0, 1, 0, 0, 0, -1, 0, 0, 1, 0]), 3));
    this.cross = new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({depthTest: false}));
    this.cross.renderOrder = 4;
    this.cross.visible = false;
  }

  update(at_W_m, radius_m, camera) {
    this.cross.visible = at_W_m !== null;
    if (at_W_m) {
      this.cross.position.set(...at_W_m);
      this.cross.quaternion.copy(camera.quaternion);
      this.cross.scale.setScalar(2.2 * radius_m);
    }
  }
}

/** A flat wall across the workspace, as a pane with a lattice on it. */
export class Wall {
  constructor() {
    this.pane = new THREE.Mesh(new THREE.PlaneBufferGeometry(1, 1), new THREE.MeshBasicMaterial({
      transparent: true, opacity: 0.16, side: THREE.DoubleSide, depthWrite: false}));
    this.lattice = new THREE.LineSegments(Wall.lattice_of(10), new THREE.LineBasicMaterial({
      transparent: true, opacity: 0.5, depthWrite: false}));
    this.group = new THREE.Group();
    this.group.add(this.pane, this.lattice);
    this.group.visible = false;
  }

  static lattice_of(cells) {
    const points = [];
    for (let i = 0; i <= cells; ++i) {
      const at = i / cells - 0.5;
      points.push(at, -0.5, 0, at, 0.5, 0, -0.5, at, 0, 0.5, at, 0);
    }
    return new THREE.BufferGeometry().setAttribute(
        'position', new THREE.BufferAttribute(new Float32Array(points), 3));
  }

  /** @param height_m along W's z; null: there is no wall. */
  place(height_m, size_m) {
    this.group.visible = height_m !== null;
    this.group.position.z = height_m || 0;
    this.group.scale.set(size_m, size_m, 1);
  }

  set_theme(palette) {
    this.pane.material.color.set(palette.of('bad'));
    this.lattice.material.color.set(palette.of('bad'));
  }
}
