// SPDX-License-Identifier: Apache-2.0
// A deformed surface. Its vertices go to the graphics card as they come, 16 bits each; the shader
// scales them. Normals are computed here, one pass over the triangles per frame.

import * as THREE from '/three.module.js';

const kCrease_cos = Math.cos(40 * Math.PI / 180);  // at rest; flatter edges are shaded smoothly
const kSmallestScale_m = 0.001;
const kScaleHold_ms = 3000;

const kVertexShader = `
  attribute vec3 rest;
  attribute vec4 outward;
  uniform vec3 low;
  uniform vec3 grain;
  uniform float full_m;
  uniform float dimmed;
  uniform vec3 ramp[4];
  varying vec3 colour;
  vec3 of_ramp(float t) {
    float at = 3.0 * clamp(t, 0.0, 1.0);
    vec3 first = mix(ramp[0], ramp[1], clamp(at, 0.0, 1.0));
    vec3 second = mix(first, ramp[2], clamp(at - 1.0, 0.0, 1.0));
    return mix(second, ramp[3], clamp(at - 2.0, 0.0, 1.0));
  }
  void main() {
    vec3 at_W_m = low + grain * position;
    vec4 seen = modelViewMatrix * vec4(at_W_m, 1.0);
    vec3 normal_W = normalize(outward.xyz + vec3(1e-6));
    vec3 normal = normalize((modelViewMatrix * vec4(normal_W, 0.0)).xyz);
    vec3 to_eye = normalize(-seen.xyz);
    float side = dot(normal, to_eye) < 0.0 ? -1.0 : 1.0;
    normal *= side;
    float key = max(0.0, dot(normal, normalize(vec3(-0.45, 0.75, 0.6))));
    float sky = 0.5 + 0.5 * side * normal_W.z;
    vec3 half_way = normalize(to_eye + normalize(vec3(-0.45, 0.75, 0.6)));
    float gloss = pow(max(0.0, dot(normal, half_way)), 24.0);
    vec3 base = of_ramp(distance(at_W_m, rest) / full_m);
    colour = base * (0.30 + 0.22 * sky + 0.56 * key) + vec3(0.10 * gloss);
    colour = mix(colour, vec3(dot(colour, vec3(0.33))), dimmed);
    gl_Position = projectionMatrix * seen;
  }`;

const kFragmentShader = `
  varying vec3 colour;
  void main() { gl_FragColor = vec4(colour, 1.0); }`;

const kLineVertexShader = `
  uniform vec3 low;
  uniform vec3 grain;
  void main() {
    gl_Position = projectionMatrix * modelViewMatrix * vec4(low + grain * position, 1.0);
    gl_Position.z -= 0.0004 * gl_Position.w;
  }`;

const kLineFragmentShader = `
  uniform vec3 tint;
  void main() { gl_FragColor = vec4(tint, 0.32); }`;

/** Normals of the triangles at rest, not normalised to length 1 where a triangle has no area. */
function triangle_normals(rest, corners) {
  const normals = new Float32Array(corners.length);
  for (let i = 0; i < corners.length; i += 3) {
    const [a, b, c] = [3 * corners[i], 3 * corners[i + 1], 3 * corners[i + 2]];
    const [ux, uy, uz] = [rest[b] - rest[a], rest[b + 1] - rest[a + 1], rest[b + 2] - rest[a + 2]];
    const [vx, vy, vz] = [rest[c] - rest[a], rest[c + 1] - rest[a + 1], rest[c + 2] - rest[a + 2]];
    const [x, y, z] = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
    const length = Math.hypot(x, y, z) || 1;
    normals.set([x / length, y / length, z / length], i);
  }
  return normals;
}

/** The corners (indices into `corners`) that meet in each vertex: those of v start at start[v]. */
function corners_of_vertices(vertices, corners) {
  const start = new Uint32Array(vertices + 1);
  for (const vertex of corners) {
    start[vertex + 1] += 1;
  }
  for (let vertex = 0; vertex < vertices; ++vertex) {
    start[vertex + 1] += start[vertex];
  }
  const next = start.slice();
  const meeting = new Uint32Array(corners.length);
  for (let corner = 0; corner < corners.length; ++corner) {
    meeting[next[corners[corner]]++] = corner;
  }
  return {start, meeting};
}

/**
 * Repeats the vertices of sharp edges, one copy for each smooth side, so that a block's edges look
 * sharp. Returns {corners, source}: corners of the drawn vertices, and the vertex of the shape that
 * each drawn one repeats. The first ones are the shape's own.
 */
function split_at_creases(shape) {
  const normals = triangle_normals(shape.rest_W_m, shape.corners);
  const {start, meeting} = corners_of_vertices(shape.vertices, shape.corners);
  const corners = Uint32Array.from(shape.corners);
  const source = Array.from({length: shape.vertices}, (_, vertex) => vertex);
  const smooth = (a, b) => {
    const [i, j] = [3 * Math.floor(a / 3), 3 * Math.floor(b / 3)];
    return normals[i] * normals[j] + normals[i + 1] * normals[j + 1] +
               normals[i + 2] * normals[j + 2] > kCrease_cos;
  };
  for (let vertex = 0; vertex < shape.vertices; ++vertex) {
    let left = Array.from(meeting.subarray(start[vertex], start[vertex + 1]));
    for (let side = 0; left.length > 0; ++side) {
      const together = [left.pop()];
      for (let i = 0; i < together.length; ++i) {
        const joined = left.filter((corner) => smooth(together[i], corner));
        together.push(...joined);
        left = left.filter((corner) => !joined.includes(corner));
      }
      if (side > 0) {
        together.forEach((corner) => { corners[corner] = source.length; });
        source.push(vertex);
      }
    }
  }
  return {corners, source: Uint32Array.from(source)};
}

/** Every edge once, as pairs of vertices. */
function edges_of(corners) {
  const edges = [];
  const seen = new Set();
  for (let i = 0; i < corners.length; i += 3) {
    for (let side = 0; side < 3; ++side) {
      const a = corners[i + side];
      const b = corners[i + (side + 1) % 3];
      const key = a < b ? a * 4294967296 + b : b * 4294967296 + a;
      if (!seen.has(key)) {
        seen.add(key);
        edges.push(a, b);
      }
    }
  }
  return Uint32Array.from(edges);
}

/** 1, 2 or 5 times a power of ten, at least `value`. */
function round_up(value) {
  const decade = 10 ** Math.floor(Math.log10(value));
  return [1, 2, 5, 10].map((digit) => digit * decade).find((round) => round >= value * 0.999);
}

export class Surface {
  /** @param shape a shape message of decode.js. */
  constructor(shape) {
    this.shape = shape;
    this.frames = 0;
    this.box = new THREE.Box3();
    this.full_m = kSmallestScale_m;
    this.last_large_ms = 0;
    const {corners, source} = split_at_creases(shape);
    this.corners = corners;
    this.source = source;
    this.positions = new Uint16Array(3 * source.length);
    this.normals = new Int8Array(4 * source.length);
    this.sums = new Float32Array(3 * source.length);
    this.make_meshes();
    this.show_rest();
  }

  make_meshes() {
    const rest = new Float32Array(3 * this.source.length);
    this.source.forEach((vertex, i) => {
      rest.set(this.shape.rest_W_m.subarray(3 * vertex, 3 * vertex + 3), 3 * i);
    });
    this.position_attribute = new THREE.BufferAttribute(this.positions, 3);
    this.normal_attribute = new THREE.BufferAttribute(this.normals, 4, true);
    this.position_attribute.setUsage(THREE.DynamicDrawUsage);
    this.normal_attribute.setUsage(THREE.DynamicDrawUsage);
    this.geometry = new THREE.BufferGeometry();
    this.geometry.setAttribute('position', this.position_attribute);
    this.geometry.setAttribute('outward', this.normal_attribute);
    this.geometry.setAttribute('rest', new THREE.BufferAttribute(rest, 3));
    this.geometry.setIndex(new THREE.BufferAttribute(this.corners, 1));
    this.uniforms = {
      low: {value: new THREE.Vector3()}, grain: {value: new THREE.Vector3()},
      full_m: {value: this.full_m}, dimmed: {value: 0},
      ramp: {value: [0, 1, 2, 3].map(() => new THREE.Color(0x808080))},
      tint: {value: new THREE.Color(0xffffff)},
    };
    this.mesh = new THREE.Mesh(this.geometry, new THREE.ShaderMaterial({
      uniforms: this.uniforms, vertexShader: kVertexShader, fragmentShader: kFragmentShader,
      side: THREE.DoubleSide}));
    this.mesh.frustumCulled = false;  // the box of its 16-bit numbers is not the surface's box
    this.lines = null;
  }

  /** The edges as lines, made when they are first shown. */
  edge_lines() {
    if (!this.lines) {
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute('position', this.position_attribute);
      geometry.setIndex(new THREE.BufferAttribute(edges_of(this.shape.corners), 1));
      this.lines = new THREE.LineSegments(geometry, new THREE.ShaderMaterial({
        uniforms: this.uniforms, vertexShader: kLineVertexShader,
        fragmentShader: kLineFragmentShader, transparent: true, depthWrite: false}));
      this.lines.frustumCulled = false;
    }
    return this.lines;
  }

  /** Shows the shape at rest until its first frame comes. */
  show_rest() {
    const rest = this.shape.rest_W_m;
    const low = [Infinity, Infinity, Infinity];
    const high = [-Infinity, -Infinity, -Infinity];
    rest.forEach((value, i) => {
      low[i % 3] = Math.min(low[i % 3], value);
      high[i % 3] = Math.max(high[i % 3], value);
    });
    const step = low.map((value, axis) => (high[axis] - value) / 65535 || 1e-9);
    const values = Uint16Array.from(rest, (value, i) => Math.round((value - low[i % 3]) / step[i % 3]));
    if (this.shape.vertices > 0) {
      this.place(low, step, values);
    }
  }

  /** Shows a frame. Returns false for one of another epoch or size. Time [ms] scales its colours. */
  update(frame, now_ms) {
    if (frame.epoch !== this.shape.epoch || frame.vertices !== this.shape.vertices) {
      return false;
    }
    this.place(frame.low, frame.step, frame.values);
    this.scale_colours(now_ms);
    this.uniforms.dimmed.value = 0;
    this.frames += 1;
    return true;
  }

  place(low, step, values) {
    this.positions.set(values);
    for (let i = this.shape.vertices; i < this.source.length; ++i) {
      const from = 3 * this.source[i];
      this.positions[3 * i] = values[from];
      this.positions[3 * i + 1] = values[from + 1];
      this.positions[3 * i + 2] = values[from + 2];
    }
    this.uniforms.low.value.set(...low);
    this.uniforms.grain.value.set(...step);
    this.compute_normals(step);
    this.measure(low, step);
    this.position_attribute.needsUpdate = true;
    this.normal_attribute.needsUpdate = true;
  }

  compute_normals(step) {
    const {corners, positions, sums, normals} = this;
    const [sx, sy, sz] = step;
    sums.fill(0);
    for (let i = 0; i < corners.length; i += 3) {
      const a = 3 * corners[i];
      const b = 3 * corners[i + 1];
      const c = 3 * corners[i + 2];
      const ux = (positions[b] - positions[a]) * sx;
      const uy = (positions[b + 1] - positions[a + 1]) * sy;
      const uz = (positions[b + 2] - positions[a + 2]) * sz;
      const vx = (positions[c] - positions[a]) * sx;
      const vy = (positions[c + 1] - positions[a + 1]) * sy;
      const vz = (positions[c + 2] - positions[a + 2]) * sz;
      const x = uy * vz - uz * vy;
      const y = uz * vx - ux * vz;
      const z = ux * vy - uy * vx;
      sums[a] += x; sums[a + 1] += y; sums[a + 2] += z;
      sums[b] += x; sums[b + 1] += y; sums[b + 2] += z;
      sums[c] += x; sums[c + 1] += y; sums[c + 2] += z;
    }
    for (let from = 0, to = 0; from < sums.length; from += 3, to += 4) {
      const x = sums[from];
      const y = sums[from + 1];
      const z = sums[from + 2];
      const factor = 127 / (Math.sqrt(x * x + y * y + z * z) || 1);
      normals[to] = x * factor;
      normals[to + 1] = y * factor;
      normals[to + 2] = z * factor;
    }
  }

  /** The box around the surface and its largest displacement [m]. */
  measure(low, step) {
    const {positions} = this;
    const rest = this.shape.rest_W_m;
    const [lx, ly, lz] = low;
    const [sx, sy, sz] = step;
    let largest2_m2 = 0;
    for (let i = 0; i < rest.length; i += 3) {
      const x = lx + sx * positions[i] - rest[i];
      const y = ly + sy * positions[i + 1] - rest[i + 1];
      const z = lz + sz * positions[i + 2] - rest[i + 2];
      largest2_m2 = Math.max(largest2_m2, x * x + y * y + z * z);
    }
    this.largest_m = Math.sqrt(largest2_m2);
    this.box.min.set(lx, ly, lz);
    this.box.max.set(lx + 65535 * sx, ly + 65535 * sy, lz + 65535 * sz);
  }

  /** The colours' range grows at once and shrinks when it was too wide for some seconds. */
  scale_colours(now_ms) {
    if (this.largest_m > 0.4 * this.full_m) {
      this.last_large_ms = now_ms;
    }
    if (this.largest_m > this.full_m) {
      this.full_m = round_up(this.largest_m);
    } else if (now_ms - this.last_large_ms > kScaleHold_ms) {
      this.full_m = Math.max(kSmallestScale_m, round_up(Math.max(this.largest_m, 1e-6)));
      this.last_large_ms = now_ms;
    }
    this.uniforms.full_m.value = this.full_m;
  }

  set_theme(palette) {
    palette.ramp.forEach((colour, i) => this.uniforms.ramp.value[i].set(colour));
    this.uniforms.tint.value.set(palette.mesh);
  }

  /** Grey, because its simulator is gone. */
  dim() {
    this.uniforms.dimmed.value = 0.85;
  }

  dispose() {
    this.geometry.dispose();
    this.mesh.material.dispose();
    if (this.lines) {
      this.lines.geometry.dispose();
      this.lines.material.dispose();
    }
  }
}
