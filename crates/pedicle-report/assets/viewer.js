"use strict";
// The scene and what is shown of it. Directions: yaw turns about the patient's long axis, pitch lifts the eye.
const BONE = [226, 214, 186], CUT = [196, 150, 118];
const SCREW_COLORS = { planned: [20, 104, 200], truth: [20, 104, 200], transferred: [214, 44, 32] };
const SIDES = 40;
// Pixels a CSS pixel along each side once nothing moves.
const FINE = 2;
const START = { anatomy: { yaw: 205, pitch: 28, zoom: 1, pan: [0, 0] }, shapes: { yaw: 30, pitch: 20, zoom: 1, pan: [0, 0] } };

class Viewer {
  constructor(scene, canvas) {
    this.scene = scene;
    this.canvas = canvas;
    this.renderer = new Renderer(canvas);
    this.groups = [...new Set(scene.parts.map((p) => p.group))];
    this.structures = [...new Set(scene.parts.map((p) => p.name))];
    const all = (names, value) => Object.fromEntries(names.map((name) => [name, value]));
    this.state = {
      layout: 0, layer: -1, opacity: scene.screws.length > 0 ? 0.5 : 1, hasSurfaces: true, ...START[scene.kind],
      roles: { planned: true, truth: true, transferred: true },
      groups: Object.fromEntries(this.groups.map((g) => [g, scene.parts.find((p) => p.group === g).shown])),
      structures: all(this.structures, true), opacities: all(this.structures, 1),
      cut: { screw: "", kind: "along", shift: 0, side: 1 },
    };
    this.meshes = scene.geometries.map((g) => this.surface(g));
    this.screws = scene.screws.map((s) => this.screw(s));
    [this.halfWidth, this.halfHeight] = this.sizeOfScene();
    this.radius = Math.hypot(this.halfWidth, this.halfHeight);
    this.drawn = 0;
    this.pace = 1;
    new ResizeObserver(() => {
      if (this.drawnSize !== `${canvas.clientWidth} ${canvas.clientHeight}`) this.redraw();
    }).observe(canvas);
    page.themes.push(() => this.redraw());
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => location.reload());
  }

  surface(geometry) {
    const positions = math.positions(geometry.positions), indices = math.indices(geometry.indices);
    const mesh = { positions, colorings: geometry.colorings, n: positions.length / 3 };
    mesh.gpu = this.renderer.upload({ positions, indices, normals: math.normals(positions, indices), colors: this.colors(mesh, -1) });
    return mesh;
  }

  /** Colours of a surface in a layer: plain where the layer has none. */
  colors(mesh, layer) {
    const coloring = mesh.colorings.find((c) => c.layer === layer);
    if (coloring && coloring.kind === "rgb") return math.bytes(coloring.data);
    const out = new Uint8Array(3 * mesh.n);
    const scale = coloring && this.scene.layers[layer].scale;
    const table = scale && Array.from({ length: 255 }, (_, k) => math.between(scale.stops, k / 254));
    const codes = coloring && math.bytes(coloring.data);
    for (let v = 0; v < mesh.n; v++) out.set(table && codes[v] < 255 ? table[codes[v]] : layer < 0 ? BONE : [170, 170, 170], 3 * v);
    return out;
  }

  /** A cylinder with a blunt tip, in the frame of its panel. */
  screw(screw) {
    const axis = math.unit(math.sub(screw.tip, screw.entry)), length = Math.hypot(...math.sub(screw.tip, screw.entry));
    const across = math.unit(math.cross(axis, Math.abs(axis[0]) < 0.8 ? [1, 0, 0] : [0, 1, 0])), third = math.cross(axis, across);
    const r = screw.diameter / 2, blunt = Math.min(1.2 * r, 0.3 * length);
    // Depth, radius, and how much the normal points along the axis: rings from the entry to the tip.
    const rings = [[0, 0, -1], [0, r, -1], [0, r, 0], [length - blunt, r, 0], [length - 0.45 * blunt, 0.8 * r, 0.6], [length, 0.25 * r, 0.9], [length, 0, 1]];
    const positions = [], normals = [], along = [], indices = [];
    rings.forEach(([depth, radius, forward], k) => {
      for (let s = 0; s < SIDES; s++) {
        const angle = (2 * Math.PI * s) / SIDES;
        const out = math.add(math.scale(across, Math.cos(angle)), math.scale(third, Math.sin(angle)));
        positions.push(...math.add(screw.entry, math.add(math.scale(axis, depth), math.scale(out, radius))));
        normals.push(...math.unit(math.add(math.scale(axis, forward), math.scale(out, Math.sqrt(Math.max(0, 1 - forward * forward))))));
        along.push(depth);
        if (k > 0) {
          const next = (s + 1) % SIDES, [a, b, c, d] = [(k - 1) * SIDES + s, (k - 1) * SIDES + next, k * SIDES + s, k * SIDES + next];
          indices.push(a, b, c, b, d, c);
        }
      }
    });
    const colors = new Uint8Array(positions.length);
    for (let v = 0; v < colors.length; v += 3) colors.set(SCREW_COLORS[screw.role], v);
    const gpu = this.renderer.upload({ positions: new Float32Array(positions), normals: new Float32Array(normals), along: new Float32Array(along), indices: new Uint32Array(indices), colors });
    return { ...screw, gpu, axis };
  }

  /** Radius and half height of a cylinder along the long axis that holds all surfaces. */
  sizeOfScene() {
    let [width, height] = [0, 0];
    for (const part of this.scene.parts) {
      const { positions } = this.meshes[part.geometry], { origin, up } = this.scene.panels[part.panel];
      // Every seventh vertex will do.
      for (let v = 0; v < positions.length; v += 21) {
        const offset = math.sub(math.place(part.pose, positions.subarray(v, v + 3)), origin), along = math.dot(offset, up);
        height = Math.max(height, Math.abs(along));
        width = Math.max(width, Math.sqrt(Math.max(0, math.dot(offset, offset) - along * along)));
      }
    }
    return width > 0 ? [width, height] : [1, 1];
  }

  set(changes) {
    Object.assign(this.state, changes);
    this.redraw();
  }

  toggle(list, name, value) {
    this.state[list][name] = value;
    this.redraw();
  }

  look(yaw, pitch) { this.set({ yaw, pitch }); }
  turn(yaw, pitch) { this.set({ yaw: this.state.yaw + yaw, pitch: Math.min(Math.max(this.state.pitch + pitch, -90), 90) }); }
  zoom(factor) { this.set({ zoom: Math.min(Math.max(this.state.zoom * factor, 0.3), 40) }); }
  move(dx, dy) {
    const scale = this.millimetresPerPixel();
    this.set({ pan: [this.state.pan[0] + dx * scale, this.state.pan[1] - dy * scale] });
  }
  reset() { this.set({ ...START[this.scene.kind], pan: [0, 0] }); }

  chooseLayer(layer) {
    this.state.layer = layer;
    for (const mesh of this.meshes) this.renderer.recolor(mesh.gpu, this.colors(mesh, layer));
    this.legend();
    this.redraw();
  }

  legend() {
    const legend = document.getElementById("legend"), layer = this.scene.layers[this.state.layer];
    legend.hidden = !layer;
    if (!layer) return;
    legend.replaceChildren();
    const line = (className, text) => {
      const element = document.createElement("div");
      element.className = className;
      element.textContent = text;
      legend.append(element);
      return element;
    };
    line("name", layer.name);
    if (!layer.scale) return;
    const { low, high, unit, stops } = layer.scale;
    line("bar", "").style.background = `linear-gradient(to right, ${stops.join(", ")})`;
    const ends = line("ends", "");
    for (const [value, word] of [[low, ""], [(low + high) / 2, ""], [high, "+"]]) {
      const end = document.createElement("span");
      end.textContent = `${Number(value.toPrecision(3))}${word} ${unit}`;
      ends.append(end);
    }
  }

  cutThrough(changes) {
    Object.assign(this.state.cut, changes);
    this.redraw();
  }

  /** The screw of a name that a column cuts along: the transferred one where there is one. */
  screwIn(panel, name) {
    const here = this.screws.filter((s) => s.panel === panel && s.name === name);
    return here.find((s) => s.role === "transferred") || here[0];
  }

  /** The plane of the cut in a panel: normal and offset; null without one. */
  cutIn(index) {
    const { screw: name, kind, shift, side } = this.state.cut, screw = name && this.screwIn(index, name);
    if (!screw) return null;
    const panel = this.scene.panels[index];
    let normal = screw.axis, point = math.add(screw.entry, math.scale(screw.axis, screw.isthmus));
    if (kind === "along") {
      normal = math.unit(math.cross(screw.axis, panel.up));
      // What lies towards the midline stays, so that the cut is seen from outside.
      if (math.dot(normal, math.sub(screw.entry, panel.origin)) < 0) normal = math.scale(normal, -1);
      point = screw.entry;
    } else if (kind === "level") {
      normal = math.unit(math.cross(math.cross(screw.axis, panel.up), screw.axis));
      point = screw.entry;
    } else {
      normal = math.scale(screw.axis, -1);
    }
    normal = math.scale(normal, side);
    return [...normal, math.dot(normal, point) + shift];
  }

  /** Turns the eye to face the cut of the last column that has one. */
  lookAtCut() {
    const columns = this.scene.layouts[this.state.layout].columns;
    const index = columns.map((c) => c.panel).reverse().find((p) => this.cutIn(p));
    if (index === undefined) return;
    const n = this.cutIn(index), panel = this.scene.panels[index];
    const [left, anterior, up] = [panel.left, panel.anterior, panel.up].map((d) => math.dot(d, n));
    this.look((Math.atan2(left, anterior) * 180) / Math.PI, (Math.asin(Math.min(Math.max(up, -1), 1)) * 180) / Math.PI);
    this.focusOn(this.state.cut.screw);
  }

  /** Brings a screw to the middle, large. */
  focusOn(name) {
    const panel = this.scene.layouts[this.state.layout].columns.map((c) => c.panel).find((p) => this.screwIn(p, name));
    if (panel === undefined) return;
    const screw = this.screwIn(panel, name), middle = math.scale(math.add(screw.entry, screw.tip), 0.5);
    const offset = math.sub(middle, this.scene.panels[panel].origin), { right, up } = this.eye(panel);
    this.set({ zoom: Math.max(2.2, this.halfHeight / 42), pan: [-math.dot(offset, right), -math.dot(offset, up)] });
  }

  /** Directions of the screen in a panel's frame. */
  eye(index) {
    const { left, anterior, up } = this.scene.panels[index];
    const [yaw, pitch] = [(this.state.yaw * Math.PI) / 180, (this.state.pitch * Math.PI) / 180];
    const level = math.add(math.scale(left, Math.sin(yaw)), math.scale(anterior, Math.cos(yaw)));
    const toward = math.add(math.scale(level, Math.cos(pitch)), math.scale(up, Math.sin(pitch)));
    const right = math.add(math.scale(left, Math.cos(yaw)), math.scale(anterior, -Math.sin(yaw)));
    return { right, up: math.cross(toward, right), toward };
  }

  columnSize() {
    const n = this.scene.layouts[this.state.layout].columns.length;
    return [this.canvas.clientWidth / n, this.canvas.clientHeight];
  }

  millimetresPerPixel() {
    const [width, height] = this.columnSize(), tall = Math.max(this.halfWidth, this.halfHeight);
    return Math.max((2.1 * this.halfWidth) / width, (2.3 * tall) / height) / this.state.zoom;
  }

  /** From a panel's frame to the clip space of a column of this size in CSS pixels. */
  projection(index, [width, height]) {
    const { right, up, toward } = this.eye(index), { origin } = this.scene.panels[index];
    const scale = this.millimetresPerPixel(), [sx, sy] = [2 / (width * scale), 2 / (height * scale)], sz = -1 / (6 * this.radius);
    const row = (direction, s, shift) => [...math.scale(direction, s), -math.dot(direction, origin) * s + shift];
    const rows = [row(right, sx, this.state.pan[0] * sx), row(up, sy, this.state.pan[1] * sy), row(toward, sz, 0), [0, 0, 0, 1]];
    const matrix = new Float32Array(16);
    rows.forEach((r, i) => r.forEach((x, j) => { matrix[4 * j + i] = x; }));
    return { clipFromPanel: matrix, eyeFromPanel: [0, 1, 2].flatMap((k) => [right[k], up[k], toward[k]]) };
  }

  /** Soon, coarsely while things move; finely, four pixels averaged to one, once they rest. */
  redraw() {
    clearTimeout(this.rest);
    this.rest = setTimeout(() => this.draw(FINE), 220);
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame((now) => {
      this.waiting = false;
      this.keepPace(now);
      this.draw(this.pace);
    });
  }

  /** Fewer pixels where frames that follow each other take long. */
  keepPace(now) {
    const took = now - (this.last || 0);
    this.last = now;
    if (took < 400) this.pace = Math.min(Math.max(this.pace * (took > 60 ? 0.8 : took < 25 ? 1.1 : 1), 0.35), 1);
  }

  draw(ratio) {
    const { scene, state, renderer } = this;
    renderer.resize(ratio);
    this.drawnSize = `${this.canvas.clientWidth} ${this.canvas.clientHeight}`;
    const columns = scene.layouts[state.layout].columns, [width, height] = this.columnSize();
    renderer.clear(math.rgb(getComputedStyle(document.documentElement).getPropertyValue("--stage").trim()));
    columns.forEach((column, k) => {
      const projection = this.projection(column.panel, [width, height]);
      const isShown = (s) => s.panel === column.panel && column.roles.includes(s.role) && state.roles[s.role] && state.structures[s.part] !== false;
      const solids = this.screws.filter(isShown).map((s) => ({ mesh: s.gpu, pose: IDENTITY, opacity: 1, stripes: !s.accepted }));
      const parts = column.surfaces && state.hasSurfaces ? scene.parts.filter((p) => p.panel === column.panel && state.groups[p.group] && state.structures[p.name]) : [];
      const surfaces = parts.map((p) => ({ mesh: this.meshes[p.geometry].gpu, pose: p.pose, opacity: state.opacity * state.opacities[p.name] }));
      const area = [Math.round(k * width * ratio), 0, Math.round(width * ratio), Math.round(height * ratio)];
      renderer.drawColumn({ area, ...projection, cut: this.cutIn(column.panel), cutColor: CUT, solids, surfaces });
    });
    this.titles(columns);
    if (this.controls) this.controls.markDirection(state);
    this.drawn += 1;
  }

  titles(columns) {
    const holder = document.getElementById("columns"), perPixel = this.millimetresPerPixel();
    const bar = [1, 2, 5, 10, 20, 50, 100].find((mm) => mm / perPixel > 60) || 200;
    const key = JSON.stringify([columns.map((c) => c.title), bar, perPixel]);
    if (key === this.titleKey) return;
    this.titleKey = key;
    holder.replaceChildren(...columns.map((column) => {
      const box = document.createElement("div"), title = document.createElement("div"), scale = document.createElement("div");
      title.className = "title";
      title.textContent = column.title;
      scale.className = "scale";
      scale.textContent = `${bar} mm`;
      scale.style.width = `${bar / perPixel}px`;
      box.append(title);
      if (this.scene.kind === "anatomy") box.append(scale);
      return box;
    }));
  }

  screenshot() {
    this.draw(FINE);
    this.canvas.toBlob((blob) => page.save("view.png", blob));
  }
}

const IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];

{
  const data = document.getElementById("scene");
  if (data) {
    try {
      const viewer = new Viewer(JSON.parse(data.textContent), document.getElementById("canvas"));
      if (viewer.scene.first_layer !== null) viewer.chooseLayer(viewer.scene.first_layer);
      viewer.controls = new Controls(viewer);
      viewer.draw(1);
      viewer.rest = setTimeout(() => viewer.draw(FINE), 220);
      window.viewer = viewer;
    } catch (error) {
      // Told in the page: everything below the view is there all the same.
      document.getElementById("no-webgl").hidden = false;
      document.getElementById("controls").hidden = true;
      if (error.message !== "no WebGL2") throw error;
    }
  }
  document.documentElement.dataset.ready = "yes";
}
