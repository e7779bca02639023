"use strict";
// The buttons, lists and sliders beside the picture, and the pointer and keys on it.
// Name, what it means, yaw and pitch in degrees.
const DIRECTIONS = {
  anatomy: [
    ["Posterior", "from behind", 180, 0], ["AP", "from the front", 0, 0], ["Left lateral", "from the patient's left", 90, 0],
    ["Right lateral", "from the patient's right", -90, 0], ["Axial", "from below", 0, -90], ["Oblique", "from behind and above", 205, 28],
  ],
  shapes: [
    ["Front", "along z", 0, 0], ["Back", "against z", 180, 0], ["Right", "along x", 90, 0],
    ["Left", "against x", -90, 0], ["Top", "along y", 0, 90], ["Oblique", "from above", 30, 20],
  ],
};

class Controls {
  constructor(viewer) {
    this.viewer = viewer;
    this.find = (id) => document.getElementById(id);
    this.directions();
    this.choices();
    this.toggles();
    this.cutting();
    this.pointer();
    this.keys();
    document.addEventListener("click", (event) => {
      const button = event.target.closest("[data-show]");
      if (button) this.show(button.dataset.show);
    });
  }

  button(parent, name, action, label) {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = name;
    if (label) button.setAttribute("aria-label", label);
    button.addEventListener("click", action);
    parent.append(button);
    return button;
  }

  directions() {
    const { viewer } = this;
    this.standard = DIRECTIONS[viewer.scene.kind];
    this.directionButtons = this.standard.map(([name, meaning, yaw, pitch]) =>
      this.button(this.find("directions"), name, () => viewer.look(yaw, pitch), `${name}, ${meaning}`));
    this.find("zoom-in").addEventListener("click", () => viewer.zoom(1.25));
    this.find("zoom-out").addEventListener("click", () => viewer.zoom(0.8));
    this.find("reset").addEventListener("click", () => viewer.reset());
    this.find("screenshot").addEventListener("click", () => viewer.screenshot());
  }

  /** Marks the standard view that is looked from, if it is one. */
  markDirection({ yaw, pitch }) {
    const isAt = (a, b) => Math.abs((((a - b) % 360) + 540) % 360 - 180) < 0.5;
    this.standard.forEach(([, , y, p], k) => {
      this.directionButtons[k].setAttribute("aria-pressed", isAt(yaw, y) && Math.abs(pitch - p) < 0.5);
    });
  }

  options(id, names, action) {
    const select = this.find(id);
    names.forEach((name, k) => select.append(new Option(name, k)));
    select.addEventListener("change", () => action(Number(select.value)));
    return select;
  }

  choices() {
    const { viewer } = this, { scene } = viewer;
    this.options("layout", scene.layouts.map((l) => l.name), (k) => viewer.set({ layout: k }));
    this.options("layer", ["plain", ...scene.layers.map((l) => l.name)], (k) => viewer.chooseLayer(k - 1));
    this.find("layer").value = viewer.state.layer + 1;
    this.find("opacity").value = viewer.state.opacity;
    this.find("opacity").addEventListener("input", (event) => viewer.set({ opacity: Number(event.target.value) }));
  }

  checkbox(parent, name, isOn, action, color) {
    const label = document.createElement("label"), box = document.createElement("input");
    box.type = "checkbox";
    box.checked = isOn;
    box.addEventListener("change", () => action(box.checked));
    label.append(box);
    if (color) {
      const swatch = document.createElement("span");
      swatch.className = "swatch";
      swatch.style.background = color;
      label.append(swatch);
    }
    label.append(name);
    parent.append(label);
    return box;
  }

  toggles() {
    const { viewer } = this, { scene, state } = viewer;
    const names = { planned: "planned", truth: "true", transferred: "transferred" };
    const roles = Object.keys(names).filter((role) => scene.screws.some((s) => s.role === role));
    for (const role of roles) {
      this.checkbox(this.find("roles"), names[role], true, (on) => viewer.toggle("roles", role, on), role === "transferred" ? "var(--red)" : "var(--blue)");
    }
    this.find("screw-toggles").hidden = roles.length === 0;
    const isAnatomy = scene.kind === "anatomy";
    if (!isAnatomy) {
      this.find("groups").parentElement.querySelector("legend").textContent = "Surfaces";
      this.find("structures").parentElement.querySelector("legend").textContent = "Parts";
      this.find("opacity").parentElement.firstChild.textContent = "Opacity ";
    }
    this.checkbox(this.find("groups"), isAnatomy ? "all bone" : "all surfaces", true, (on) => viewer.set({ hasSurfaces: on })).id = "bone";
    for (const group of viewer.groups) {
      this.checkbox(this.find("groups"), group, state.groups[group], (on) => viewer.toggle("groups", group, on));
    }
    for (const name of viewer.structures) {
      const row = document.createElement("div"), slider = document.createElement("input");
      row.className = "structure";
      this.checkbox(row, name, true, (on) => viewer.toggle("structures", name, on));
      Object.assign(slider, { type: "range", min: 0.05, max: 1, step: 0.05, value: 1 });
      slider.setAttribute("aria-label", `Opacity of ${name}`);
      slider.addEventListener("input", () => viewer.toggle("opacities", name, Number(slider.value)));
      row.append(slider);
      this.find("structures").append(row);
    }
  }

  cutting() {
    const { viewer } = this, names = [...new Set(viewer.scene.screws.map((s) => s.name))];
    this.find("cutting").hidden = names.length === 0;
    const select = this.find("cut-screw");
    select.append(new Option("no cut", ""));
    names.forEach((name) => select.append(new Option(name, name)));
    select.addEventListener("change", () => viewer.cutThrough({ screw: select.value }));
    this.find("cut-kind").addEventListener("change", (event) => viewer.cutThrough({ kind: event.target.value }));
    this.find("cut-shift").addEventListener("input", (event) => viewer.cutThrough({ shift: Number(event.target.value) }));
    this.find("cut-flip").addEventListener("click", () => viewer.cutThrough({ side: -viewer.state.cut.side }));
    this.find("cut-face").addEventListener("click", () => viewer.lookAtCut());
  }

  /** From the card of a screw: cut along it and look at the cut. */
  show(name) {
    const { viewer } = this;
    this.find("cut-screw").value = name;
    this.find("cut-kind").value = "along";
    this.find("cut-shift").value = 0;
    viewer.cutThrough({ screw: name, kind: "along", shift: 0 });
    viewer.focusOn(name);
    viewer.lookAtCut();
    this.find("view").scrollIntoView();
    this.find("canvas").focus({ preventScroll: true });
  }

  pointer() {
    const { viewer } = this, { canvas } = viewer, fingers = new Map();
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    canvas.addEventListener("pointermove", (event) => {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      const now = [event.clientX, event.clientY], [dx, dy] = [now[0] - before[0], now[1] - before[1]];
      if (fingers.size === 2) {
        const other = [...fingers].find(([id]) => id !== event.pointerId)[1];
        const distance = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]) || 1;
        viewer.zoom(distance(now) / distance(before));
        viewer.move(dx / 2, dy / 2);
      } else if (event.shiftKey || event.buttons & 6) {
        viewer.move(dx, dy);
      } else {
        viewer.turn(-0.45 * dx, 0.45 * dy);
      }
      fingers.set(event.pointerId, now);
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      viewer.zoom(Math.exp(-0.0015 * event.deltaY));
    }, { passive: false });
  }

  keys() {
    const { viewer } = this;
    const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    viewer.canvas.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      const arrow = arrows[event.key];
      if (arrow && event.shiftKey) viewer.move(20 * arrow[0], 20 * arrow[1]);
      else if (arrow) viewer.turn(-8 * arrow[0], 8 * arrow[1]);
      else if (event.key === "+" || event.key === "=") viewer.zoom(1.2);
      else if (event.key === "-") viewer.zoom(1 / 1.2);
      else if (event.key === "r" || event.key === "R") viewer.reset();
      else return;
      event.preventDefault();
    });
  }
}
