"use strict";
// Surfaces and screws drawn with WebGL2: opaque screws, then the front layer of the bone over them.
const VERTEX_SHADER = `#version 300 es
in vec3 position; in vec3 normal; in vec3 color; in float along;
uniform mat4 panelFromModel, clipFromPanel; uniform mat3 eyeFromPanel;
out vec3 vNormal, vColor, vPanel; out float vAlong;
void main() {
  vec4 p = panelFromModel * vec4(position, 1.0);
  vPanel = p.xyz;
  vNormal = eyeFromPanel * mat3(panelFromModel) * normal;
  vColor = color;
  vAlong = along;
  gl_Position = clipFromPanel * p;
}`;
const FRAGMENT_SHADER = `#version 300 es
precision highp float;
in vec3 vNormal, vColor, vPanel; in float vAlong;
uniform vec4 cut;           // panel frame: kept where dot(cut.xyz, p) <= cut.w
uniform vec3 cutColor;
uniform float opacity, hasCut, stripes, onlyDepth;
out vec4 fragment;
void main() {
  if (hasCut > 0.5 && dot(cut.xyz, vPanel) > cut.w) discard;
  if (onlyDepth > 0.5) { fragment = vec4(0.0); return; }
  vec3 n = normalize(vNormal);
  if (!gl_FrontFacing && hasCut > 0.5) { fragment = vec4(cutColor, 1.0); return; }
  if (!gl_FrontFacing) n = -n;
  float key = max(dot(n, normalize(vec3(-0.35, 0.55, 0.85))), 0.0);
  float fill = max(dot(n, normalize(vec3(0.7, -0.2, 0.45))), 0.0);
  float edge = 1.0 - abs(n.z), rim = edge * edge * edge;
  vec3 c = vColor * (0.34 + 0.62 * key + 0.18 * fill);
  if (stripes > 0.5 && mod(vAlong, 4.0) < 1.6) c *= 0.25;
  fragment = vec4(c, min(1.0, opacity + (1.0 - opacity) * 0.55 * rim));
}`;

class Renderer {
  constructor(canvas) {
    this.canvas = canvas;
    const gl = canvas.getContext("webgl2", { antialias: false, alpha: true, premultipliedAlpha: false });
    if (!gl) throw new Error("no WebGL2");
    this.gl = gl;
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX_SHADER], [gl.FRAGMENT_SHADER, FRAGMENT_SHADER]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    ["position", "normal", "color", "along"].forEach((name, k) => gl.bindAttribLocation(program, k, name));
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    gl.useProgram(program);
    this.uniforms = {};
    for (const name of ["panelFromModel", "clipFromPanel", "eyeFromPanel", "cut", "cutColor", "opacity", "hasCut", "stripes", "onlyDepth"]) {
      this.uniforms[name] = gl.getUniformLocation(program, name);
    }
    gl.enable(gl.DEPTH_TEST);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  /** A mesh on the card; colours can be replaced later. */
  upload({ positions, normals, indices, colors, along }) {
    const gl = this.gl;
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    const buffer = (slot, data, size, kind, normalized) => {
      const name = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, name);
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(slot);
      gl.vertexAttribPointer(slot, size, kind, normalized, 0, 0);
      return name;
    };
    buffer(0, positions, 3, gl.FLOAT, false);
    buffer(1, normals, 3, gl.FLOAT, false);
    const colorBuffer = buffer(2, colors, 3, gl.UNSIGNED_BYTE, true);
    if (along) buffer(3, along, 1, gl.FLOAT, false);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
    return { array, colorBuffer, count: indices.length };
  }

  recolor(mesh, colors) {
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, mesh.colorBuffer);
    this.gl.bufferData(this.gl.ARRAY_BUFFER, colors, this.gl.STATIC_DRAW);
  }

  /** Gives the picture `ratio` pixels a CSS pixel along each side. */
  resize(ratio) {
    const width = Math.round(this.canvas.clientWidth * ratio), height = Math.round(this.canvas.clientHeight * ratio);
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
    }
  }

  clear(color) {
    const gl = this.gl;
    gl.disable(gl.SCISSOR_TEST);
    gl.clearColor(color[0] / 255, color[1] / 255, color[2] / 255, 1);
    gl.depthMask(true);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  }

  /** One column of the picture: `area` in device pixels, things with mesh, pose, opacity and stripes. */
  drawColumn({ area, clipFromPanel, eyeFromPanel, cut, cutColor, solids, surfaces }) {
    const gl = this.gl, u = this.uniforms;
    gl.viewport(...area);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(...area);
    gl.uniformMatrix4fv(u.clipFromPanel, false, clipFromPanel);
    gl.uniformMatrix3fv(u.eyeFromPanel, false, eyeFromPanel);
    gl.uniform3fv(u.cutColor, cutColor.map((x) => x / 255));
    const draw = (thing) => {
      gl.bindVertexArray(thing.mesh.array);
      gl.uniformMatrix4fv(u.panelFromModel, false, thing.pose);
      gl.uniform1f(u.opacity, thing.opacity);
      gl.uniform1f(u.stripes, thing.stripes ? 1 : 0);
      gl.drawElements(gl.TRIANGLES, thing.mesh.count, gl.UNSIGNED_INT, 0);
    };
    gl.disable(gl.BLEND);
    gl.depthMask(true);
    gl.depthFunc(gl.LESS);
    gl.uniform1f(u.hasCut, 0);
    gl.uniform1f(u.onlyDepth, 0);
    solids.forEach(draw);
    gl.uniform1f(u.hasCut, cut ? 1 : 0);
    if (cut) gl.uniform4fv(u.cut, cut);
    surfaces.filter((s) => s.opacity >= 0.995).forEach(draw);
    const clear = surfaces.filter((s) => s.opacity < 0.995 && s.opacity > 0);
    // The depth of the nearest layer first, then its colour: no layer shines through another.
    gl.colorMask(false, false, false, false);
    gl.uniform1f(u.onlyDepth, 1);
    clear.forEach(draw);
    gl.uniform1f(u.onlyDepth, 0);
    gl.colorMask(true, true, true, true);
    gl.enable(gl.BLEND);
    gl.depthFunc(gl.EQUAL);
    clear.forEach(draw);
    gl.depthFunc(gl.LESS);
    gl.disable(gl.BLEND);
    gl.bindVertexArray(null);
  }
}
