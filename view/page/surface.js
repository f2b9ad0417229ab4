// SPDX-License-Identifier: Apache-2.0
// A deformed surface. Its vertices go to the graphics card as they come, 16 bits each; the shader
// scales them. Normals are computed here, one pass over the triangles per frame.

import * as THREE from '/three.module.js';
import {set_to_picture} from '/inside.js';
import {Scale} from '/scale.js';
import {Section, kLineVertexShader, kSectionFragment, kSectionFragmentHead, kSectionVertex,
        kSectionVertexHead} from '/section.js';

const kCrease_cos = Math.cos(40 * Math.PI / 180);  // at rest; flatter edges are shaded smoothly
const kSmallestScale_m = 0.001;
const kSmallestStrain = 0.01;
const kLight = [-0.55, 0.55, 0.75];  // direction in the camera's frame

// Little work per vertex: a computer without a graphics card runs this, too.
const kVertexShader = `
  attribute vec4 outward;  // normal in W, and the displacement as a share of the ramp
  uniform mat4 to_picture;
  uniform vec3 low;
  uniform vec3 grain;
  uniform vec3 eye_W;
  uniform vec3 light_W;
  uniform vec3 gloss_W;
  uniform float dimmed;
  uniform vec3 ramp[4];
  varying vec3 colour;
  ${kSectionVertexHead}
  void main() {
    vec3 at_W_m = low + grain * position;
    ${kSectionVertex}
    float side = dot(outward.xyz, eye_W - at_W_m) < 0.0 ? -1.0 : 1.0;
    vec3 normal = side * outward.xyz;
    float gloss = max(0.0, dot(normal, gloss_W));
    gloss *= gloss;
    gloss *= gloss;
    gloss *= gloss;
    float place = 3.0 * outward.w;
    vec3 base = mix(ramp[0], ramp[1], min(place, 1.0));
    base = mix(base, ramp[2], clamp(place - 1.0, 0.0, 1.0));
    base = mix(base, ramp[3], max(place - 2.0, 0.0));
    colour = base * (0.50 + 0.14 * normal.z + 0.48 * max(0.0, dot(normal, light_W)));
    colour += 0.10 * gloss * gloss;
    colour = mix(colour, vec3(dot(colour, vec3(0.33))), dimmed);
    gl_Position = to_picture * vec4(position, 1.0);
  }`;

const kFragmentShader = `
  varying vec3 colour;
  ${kSectionFragmentHead}
  void main() {
    ${kSectionFragment}
    gl_FragColor = vec4(colour, 1.0);
  }`;

const kLineFragmentShader = `
  uniform vec3 tint;
  ${kSectionFragmentHead}
  void main() {
    ${kSectionFragment}
    gl_FragColor = vec4(tint, 0.24);
  }`;

/** Normals of the triangles at rest, not normalised to length 1 where a triangle has no area. */
function triangle_normals(rest, corners) {
  const normals = new Float32Array(corners.length);
  for (let i = 0; i < corners.length; i += 3) {
    const a = 3 * corners[i];
    const b = 3 * corners[i + 1];
    const c = 3 * corners[i + 2];
    const ux = rest[b] - rest[a];
    const uy = rest[b + 1] - rest[a + 1];
    const uz = rest[b + 2] - rest[a + 2];
    const vx = rest[c] - rest[a];
    const vy = rest[c + 1] - rest[a + 1];
    const vz = rest[c + 2] - rest[a + 2];
    const x = uy * vz - uz * vy;
    const y = uz * vx - ux * vz;
    const z = ux * vy - uy * vx;
    const length = Math.sqrt(x * x + y * y + z * z) || 1;
    normals[i] = x / length;
    normals[i + 1] = y / length;
    normals[i + 2] = z / length;
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
    let next = start[vertex];
    while (next < start[vertex + 1] && smooth(meeting[start[vertex]], meeting[next])) {
      ++next;
    }
    if (next === start[vertex + 1]) {
      continue;  // one smooth side, as most vertices have
    }
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

/**
 * Which sides of the triangles can be seen: the outer ones of a closed surface, both of any other.
 * A surface is closed if every edge runs once in each direction.
 */
function visible_sides(rest, corners) {
  let open = 0;  // a sum over the edges in which opposite directions cancel
  let volume_m3 = 0;
  for (let i = 0; i < corners.length; i += 3) {
    for (let side = 0; side < 3; ++side) {
      const a = corners[i + side];
      const b = corners[i + (side + 1) % 3];
      const mark =
          Math.imul(Math.min(a, b) + 1, 73856093) ^ Math.imul(Math.max(a, b) + 1, 19349663);
      open = (open + (a < b ? mark : -mark)) | 0;
    }
    const [a, b, c] = [3 * corners[i], 3 * corners[i + 1], 3 * corners[i + 2]];
    volume_m3 += (rest[a] * (rest[b + 1] * rest[c + 2] - rest[b + 2] * rest[c + 1]) +
                  rest[a + 1] * (rest[b + 2] * rest[c] - rest[b] * rest[c + 2]) +
                  rest[a + 2] * (rest[b] * rest[c + 1] - rest[b + 1] * rest[c])) / 6;
  }
  return open !== 0 ? THREE.DoubleSide : volume_m3 > 0 ? THREE.FrontSide : THREE.BackSide;
}

export class Surface {
  /** @param shape a shape message of decode.js. @param section a plane that may open it. */
  constructor(shape, section = new Section()) {
    this.shape = shape;
    this.section = section;
    this.frames = 0;
    this.box = new THREE.Box3();
    this.scale = new Scale(kSmallestScale_m);
    this.strain_scale = new Scale(kSmallestStrain);
    this.full = kSmallestScale_m;  // end of the colours' range, in metres or as a strain
    const {corners, source} = split_at_creases(shape);
    this.corners = corners;
    this.source = source;
    this.positions = new Uint16Array(3 * source.length);
    this.normals = new Int8Array(4 * source.length);
    this.sums = new Float32Array(3 * source.length);
    this.displacements_m = new Float32Array(shape.vertices);
    this.colouring = 'displacement';
    this.edges = null;  // for the strain: made when it is first shown
    this.make_meshes();
    this.show_rest();
  }

  make_meshes() {
    this.position_attribute = new THREE.BufferAttribute(this.positions, 3);
    this.normal_attribute = new THREE.BufferAttribute(this.normals, 4, true);
    this.position_attribute.setUsage(THREE.DynamicDrawUsage);
    this.normal_attribute.setUsage(THREE.DynamicDrawUsage);
    this.geometry = new THREE.BufferGeometry();
    this.geometry.setAttribute('position', this.position_attribute);
    this.geometry.setAttribute('outward', this.normal_attribute);
    this.geometry.setIndex(new THREE.BufferAttribute(this.corners, 1));
    this.uniforms = {
      low: {value: new THREE.Vector3()}, grain: {value: new THREE.Vector3()},
      to_picture: {value: new THREE.Matrix4()}, eye_W: {value: new THREE.Vector3()},
      light_W: {value: new THREE.Vector3()}, gloss_W: {value: new THREE.Vector3()},
      dimmed: {value: 0},
      ramp: {value: [0, 1, 2, 3].map(() => new THREE.Color(0x808080))},
      tint: {value: new THREE.Color(0xffffff)},
      section: this.section.uniform,
    };
    this.side = visible_sides(this.shape.rest_W_m, this.shape.corners);
    this.mesh = new THREE.Mesh(this.geometry, new THREE.ShaderMaterial({
      uniforms: this.uniforms, vertexShader: kVertexShader, fragmentShader: kFragmentShader}));
    this.apply_section();
    this.mesh.frustumCulled = false;  // the box of its 16-bit numbers is not the surface's box
    this.mesh.onBeforeRender = (renderer, scene, camera) => this.aim(camera);
    this.lines = null;
  }

  /** After the section was switched on or off. Opened, the surface is seen from within, too. */
  apply_section() {
    this.mesh.material.side = this.section.active ? THREE.DoubleSide : this.side;
    this.section.apply(this.mesh.material);
    if (this.lines) {
      this.section.apply(this.lines.material);
    }
  }

  /** Transformation from 16-bit numbers to the picture, and lights that move with the camera. */
  aim(camera) {
    const {to_picture, low, grain, eye_W, light_W, gloss_W} = this.uniforms;
    set_to_picture(to_picture.value, low.value, grain.value, camera);
    eye_W.value.setFromMatrixPosition(camera.matrixWorld);
    light_W.value.set(...kLight).normalize().transformDirection(camera.matrixWorld);
    gloss_W.value.set(...kLight).normalize().add(new THREE.Vector3(0, 0, 1)).normalize()
        .transformDirection(camera.matrixWorld);
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
      this.section.apply(this.lines.material);
      this.lines.frustumCulled = false;
      this.lines.onBeforeRender = (renderer, scene, camera) => this.aim(camera);
    }
    return this.lines;
  }

  /** Shows the shape at rest until its first frame comes. */
  show_rest() {
    const rest = this.shape.rest_W_m;
    const low = [Infinity, Infinity, Infinity];
    const high = [-Infinity, -Infinity, -Infinity];
    for (let i = 0; i < rest.length; ++i) {
      low[i % 3] = Math.min(low[i % 3], rest[i]);
      high[i % 3] = Math.max(high[i % 3], rest[i]);
    }
    const step = low.map((value, axis) => (high[axis] - value) / 65535 || 1e-9);
    const values =
        Uint16Array.from(rest, (value, i) => Math.round((value - low[i % 3]) / step[i % 3]));
    if (this.shape.vertices > 0) {
      this.place(low, step, values);
    }
  }

  /**
   * Shows a frame. Returns false for one of another epoch or size. Time [ms] scales its colours.
   */
  update(frame, now_ms) {
    if (frame.epoch !== this.shape.epoch || frame.vertices !== this.shape.vertices) {
      return false;
    }
    this.place(frame.low, frame.step, frame.values, now_ms);
    this.uniforms.dimmed.value = 0;
    this.frames += 1;
    return true;
  }

  place(low, step, values, now_ms = 0) {
    this.positions.set(values);
    for (let i = this.shape.vertices; i < this.source.length; ++i) {
      const from = 3 * this.source[i];
      this.positions[3 * i] = values[from];
      this.positions[3 * i + 1] = values[from + 1];
      this.positions[3 * i + 2] = values[from + 2];
    }
    this.uniforms.low.value.set(...low);
    this.uniforms.grain.value.set(...step);
    this.measure(low, step);
    if (this.colouring === 'strain') {
      this.measure_strain(step);
      this.full = this.strain_scale.update(this.largest_strain, now_ms);
    } else {
      this.full = this.scale.update(this.largest_m, now_ms);
    }
    this.compute_normals(step);
    this.colour();
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

  /** Writes each vertex's value beside its normal, 127 for the end of the colours' range. */
  colour() {
    const {normals, source} = this;
    const values = this.colouring === 'strain' ? this.strains : this.displacements_m;
    const factor = 127 / this.full;
    for (let i = 0, to = 3; i < source.length; ++i, to += 4) {
      normals[to] = Math.min(127, values[source[i]] * factor);
    }
  }

  /** @param colouring 'displacement' or 'strain'; seen from the next frame on. */
  set_colouring(colouring) {
    this.colouring = colouring;
    this.full = colouring === 'strain' ? kSmallestStrain : kSmallestScale_m;
  }

  make_edges() {
    this.edges = edges_of(this.shape.corners);
    this.strains = new Float32Array(this.shape.vertices);
    const rest = this.shape.rest_W_m;
    this.rest_lengths = Float32Array.from({length: this.edges.length / 2}, (_, i) => {
      const [a, b] = [3 * this.edges[2 * i], 3 * this.edges[2 * i + 1]];
      return Math.hypot(rest[a] - rest[b], rest[a + 1] - rest[b + 1], rest[a + 2] - rest[b + 2]);
    });
  }

  /** Each vertex's strain: the largest |l / l0 - 1| of the surface's edges that meet in it. */
  measure_strain(step) {
    if (!this.edges) {
      this.make_edges();
    }
    const {edges, positions, rest_lengths, strains} = this;
    const [sx, sy, sz] = step;
    strains.fill(0);
    this.largest_strain = 0;
    for (let i = 0; i < rest_lengths.length; ++i) {
      const [va, vb] = [edges[2 * i], edges[2 * i + 1]];
      const x = (positions[3 * va] - positions[3 * vb]) * sx;
      const y = (positions[3 * va + 1] - positions[3 * vb + 1]) * sy;
      const z = (positions[3 * va + 2] - positions[3 * vb + 2]) * sz;
      const strain = Math.abs(Math.sqrt(x * x + y * y + z * z) / rest_lengths[i] - 1);
      strains[va] = Math.max(strains[va], strain);
      strains[vb] = Math.max(strains[vb], strain);
      this.largest_strain = Math.max(this.largest_strain, strain);
    }
  }

  /** The box around the surface, each vertex's displacement and the largest one [m]. */
  measure(low, step) {
    const {positions, displacements_m} = this;
    const rest = this.shape.rest_W_m;
    const [lx, ly, lz] = low;
    const [sx, sy, sz] = step;
    this.largest_m = 0;
    for (let i = 0, vertex = 0; i < rest.length; i += 3, ++vertex) {
      const x = lx + sx * positions[i] - rest[i];
      const y = ly + sy * positions[i + 1] - rest[i + 1];
      const z = lz + sz * positions[i + 2] - rest[i + 2];
      const length_m = Math.sqrt(x * x + y * y + z * z);
      displacements_m[vertex] = length_m;
      this.largest_m = Math.max(this.largest_m, length_m);
    }
    this.box.min.set(lx, ly, lz);
    this.box.max.set(lx + 65535 * sx, ly + 65535 * sy, lz + 65535 * sz);
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
