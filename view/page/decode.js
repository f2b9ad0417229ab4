// SPDX-License-Identifier: Apache-2.0
// Binary messages of the live view. Numbers are little-endian, as on every machine that runs a
// browser today. The functions return null for a message that is truncated or of an unknown type.

export const kScope = 1;
export const kShape = 2;
export const kFrame = 3;
export const kSamples = 4;
export const kArm = 5;
export const kField = 6;
export const kBlocks = 7;
export const kInsideLines = 8;
export const kInsideFrame = 9;
export const kOtherTool = 10;
export const kSampleValues = 12;

/** Rows of the scope: values[row * columns + column], float32; base_s [s] is added to each time. */
function decode_scope(buffer, view) {
  const rows = view.getUint16(2, true);
  const columns = view.getUint32(4, true);
  if (buffer.byteLength < 16 + 4 * rows * columns) {
    return null;
  }
  return {type: kScope, rows, columns, base_s: view.getFloat64(8, true),
          values: new Float32Array(buffer, 16, rows * columns)};
}

/** The surface at rest: rest_W_m (x, y, z per vertex) and the corners of its triangles. */
function decode_shape(buffer, view) {
  const epoch = view.getUint32(4, true);
  const vertices = view.getUint32(8, true);
  const triangles = view.getUint32(12, true);
  if (buffer.byteLength < 20 + 12 * vertices + 12 * triangles) {
    return null;
  }
  return {type: kShape, object: view.getUint8(1), epoch, vertices, triangles,
          rest_W_m: new Float32Array(buffer, 20, 3 * vertices),
          corners: new Uint32Array(buffer, 20 + 12 * vertices, 3 * triangles)};
}

/** The surface or the lines at one instant: position_W_m = low + step * value, for x, y and z. */
function decode_frame(buffer, view) {
  const vertices = view.getUint32(8, true);
  if (buffer.byteLength < 48 + 6 * vertices) {
    return null;
  }
  return {type: view.getUint8(0), object: view.getUint8(1), epoch: view.getUint32(4, true), vertices,
          time_s: view.getFloat64(16, true), low: new Float32Array(buffer, 24, 3),
          step: new Float32Array(buffer, 36, 3),
          values: new Uint16Array(buffer, 48, 3 * vertices)};
}

/** Samples: kSampleValues float32 each: position_W_m, force_W_N, time_s, flags (1: in contact, 2:
 *  the answer to a request), contact_point_W_m, epoch. */
function decode_samples(buffer, view) {
  const count = view.getUint16(2, true);
  if (buffer.byteLength < 8 + 4 * kSampleValues * count) {
    return null;
  }
  return {type: kSamples, count, values: new Float32Array(buffer, 8, kSampleValues * count)};
}

/** A tool's arm: a list of lines, its links, each a Float32Array of x, y, z [m] in W. */
function decode_arm(buffer, view) {
  const lines = [];
  let at = 8;
  for (let line = view.getUint32(4, true); line > 0; --line) {
    if (at + 4 > buffer.byteLength) {
      return null;
    }
    const points = view.getUint32(at, true);
    if (at + 4 + 12 * points > buffer.byteLength) {
      return null;
    }
    lines.push(new Float32Array(buffer, at + 4, 3 * points));
    at += 4 + 12 * points;
  }
  return {type: kArm, tool: view.getUint8(1), lines};
}

/** Where another tool is, and the force on its hand. */
function decode_other_tool(buffer, view) {
  const vector = (at) => [0, 4, 8].map((axis) => view.getFloat32(at + axis, true));
  return {type: kOtherTool, tool: view.getUint8(1), position_W_m: vector(4),
          force_W_N: vector(16), in_contact: view.getFloat32(28, true) > 0};
}

/** A slice of the force field: points x points values of force x, y, z [N], uncertainty [N] and
 *  status; the first is at `corner`, the next of a row `across` away, the next row `along` away. */
function decode_field(buffer, view) {
  const points = view.getUint16(4, true);
  if (buffer.byteLength < 44 + 20 * points * points) {
    return null;
  }
  const vector = (at) => [0, 4, 8].map((axis) => view.getFloat32(at + axis, true));
  return {type: kField, method: view.getUint8(1), compared: view.getUint8(2), points,
          exact: view.getUint16(6, true) === 1, corner: vector(8), across: vector(20),
          along: vector(32), values: new Float32Array(buffer, 44, 5 * points * points)};
}

/** Blocks of storage: 7 values each, the method's number in `methods`, then the low and the high
 *  corner [m] in `values`. `in_use` also counts those that were not sent. */
function decode_blocks(buffer, view) {
  const count = view.getUint16(2, true);
  if (buffer.byteLength < 8 + 28 * count) {
    return null;
  }
  return {type: kBlocks, count, in_use: view.getUint32(4, true),
          methods: new Uint32Array(buffer, 8, 7 * count),
          values: new Float32Array(buffer, 8, 7 * count)};
}

/** What is inside an object: how many springs it has, and edges of tetrahedra, and in `ends` the two
 *  vertices of each; none if there are too many. */
function decode_lines(buffer, view) {
  const [epoch, vertices, springs, element_edges, edges] =
      [4, 8, 12, 16, 20].map((at) => view.getUint32(at, true));
  if (buffer.byteLength < 24 + 8 * edges) {
    return null;
  }
  return {type: kInsideLines, object: view.getUint8(1), epoch, vertices, springs, element_edges,
          ends: new Uint32Array(buffer, 24, 2 * edges)};
}

const kDecoders = {
  [kScope]: [16, decode_scope],
  [kShape]: [20, decode_shape],
  [kFrame]: [48, decode_frame],
  [kSamples]: [8, decode_samples],
  [kArm]: [8, decode_arm],
  [kField]: [44, decode_field],
  [kBlocks]: [8, decode_blocks],
  [kInsideLines]: [24, decode_lines],
  [kInsideFrame]: [48, decode_frame],
  [kOtherTool]: [32, decode_other_tool],
};

/** A message of any type, as an object with its `type`. Its arrays share the buffer's memory. */
export function decode(buffer) {
  const view = new DataView(buffer);
  const [header_bytes, decoder] =
      (buffer.byteLength > 0 && kDecoders[view.getUint8(0)]) || [Infinity, null];
  return buffer.byteLength < header_bytes ? null : decoder(buffer, view);
}
