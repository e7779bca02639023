"use strict";
// Vectors as arrays of three numbers, matrices as 16 numbers, column by column.
const math = {
  add: (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]],
  sub: (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]],
  scale: (a, s) => [a[0] * s, a[1] * s, a[2] * s],
  dot: (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2],
  cross: (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]],
  unit(a) {
    const length = Math.hypot(...a);
    return length > 0 ? math.scale(a, 1 / length) : [0, 0, 0];
  },
  multiply(a, b) {
    const out = new Float32Array(16);
    for (let c = 0; c < 4; c++) {
      for (let r = 0; r < 4; r++) {
        let sum = 0;
        for (let k = 0; k < 4; k++) sum += a[4 * k + r] * b[4 * c + k];
        out[4 * c + r] = sum;
      }
    }
    return out;
  },
  /** The place of a point under a matrix. */
  place: (m, p) => [0, 1, 2].map((r) => m[r] * p[0] + m[4 + r] * p[1] + m[8 + r] * p[2] + m[12 + r]),

  /** Base64 to bytes. */
  bytes: (text) => Uint8Array.fromBase64 ? Uint8Array.fromBase64(text) : Uint8Array.from(atob(text), (c) => c.charCodeAt(0)),

  /** Positions of 16 bits to numbers. */
  positions({ low, step, data }) {
    const codes = new Uint16Array(math.bytes(data).buffer);
    const out = new Float32Array(codes.length);
    for (let i = 0; i < codes.length; i++) out[i] = low[i % 3] + step * codes[i];
    return out;
  },

  /** Differences as zigzag varints to indices. */
  indices(text) {
    const bytes = math.bytes(text);
    const out = new Uint32Array(bytes.length);
    let n = 0, last = 0, value = 0, factor = 1;
    for (const byte of bytes) {
      value += (byte & 127) * factor;
      factor *= 128;
      if (byte < 128) {
        last += value % 2 ? -(value + 1) / 2 : value / 2;
        out[n++] = last;
        value = 0;
        factor = 1;
      }
    }
    return out.slice(0, n);
  },

  /** Unit normals of the vertices, weighted by area. */
  normals(positions, indices) {
    const out = new Float32Array(positions.length);
    for (let f = 0; f < indices.length; f += 3) {
      const [a, b, c] = [3 * indices[f], 3 * indices[f + 1], 3 * indices[f + 2]];
      const ux = positions[b] - positions[a], uy = positions[b + 1] - positions[a + 1], uz = positions[b + 2] - positions[a + 2];
      const vx = positions[c] - positions[a], vy = positions[c + 1] - positions[a + 1], vz = positions[c + 2] - positions[a + 2];
      const nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
      for (const v of [a, b, c]) {
        out[v] += nx;
        out[v + 1] += ny;
        out[v + 2] += nz;
      }
    }
    for (let v = 0; v < out.length; v += 3) {
      const length = Math.hypot(out[v], out[v + 1], out[v + 2]) || 1;
      out[v] /= length;
      out[v + 1] /= length;
      out[v + 2] /= length;
    }
    return out;
  },

  /** "#rrggbb" to three numbers of 0 to 255. */
  rgb: (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16)),

  /** A colour between the stops of a scale, t from 0 to 1. */
  between(stops, t) {
    const at = Math.min(Math.max(t, 0), 1) * (stops.length - 1);
    const k = Math.min(Math.floor(at), stops.length - 2);
    const [a, b] = [math.rgb(stops[k]), math.rgb(stops[k + 1])];
    return a.map((x, c) => x + (b[c] - x) * (at - k));
  },
};
