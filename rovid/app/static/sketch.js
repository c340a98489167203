// Sketch of the vehicle from above, bow up: each thruster at its position, with an arrow in the direction of its thrust.
// Body axes: x ahead, y to starboard, angles from the bow to starboard.
import { tidy } from "./tools.js";

const SVG = "http://www.w3.org/2000/svg";
const RADIANS = Math.PI / 180;

// Yaw arm of a thrust of 1: x·Fy − y·Fx.
export const armOf = ({ x, y, angle }) => x * Math.sin(angle * RADIANS) - y * Math.cos(angle * RADIANS);

// A position for a thruster with a known arm only, clear of the thrusters `before` on the same side.
export function standing(name, arm, before = []) {
  const size = Math.abs(arm);
  if (/bow|fore|fwd|front|bug/i.test(name)) return { x: size, y: 0, angle: arm < 0 ? -90 : 90 };
  if (/stern|aft|rear|heck/i.test(name)) return { x: -size, y: 0, angle: arm < 0 ? 90 : -90 };
  const port = /port|left|links|bb|babord/i.test(name) || (!/star|stb|right|recht|tribord/i.test(name) && arm > 0);
  const y = port ? -size : size;
  const beside = before.filter((one) => one.y === y).length;
  return { x: 1.4 * size * Math.ceil(beside / 2) * (beside % 2 ? -1 : 1), y, angle: (port ? 1 : -1) * arm < 0 ? 180 : 0 };
}

function svg(name, attributes, parent) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  parent?.append(made);
  return made;
}

export class Sketch {
  // `moved(name, place)` is called when the user moves a thruster.
  constructor(root, moved) {
    Object.assign(this, { root, moved, thrusters: [], size: [1, 0.7] });
    root.addEventListener("pointermove", (event) => this.drag(event));
    for (const end of ["pointerup", "pointercancel"]) root.addEventListener(end, () => { this.held = null; });
  }

  // Thrusters as {name, x, y, angle, arm}; length and width in m.
  draw(thrusters, length, width) {
    this.thrusters = thrusters;
    const focused = document.activeElement?.dataset?.thruster;
    const l = length || 1.4 * (width || 0), w = width || 0.7 * (length || 0);
    const far = Math.max(...thrusters.map(({ x, y }) => Math.max(Math.abs(x), Math.abs(y))), 0.05);
    const hull = l ? [l, w] : [2.2 * far, 1.7 * far];
    // The scale does not change while a thruster is dragged.
    if (!this.held) this.half = 0.75 * Math.max(hull[0], hull[1], 2.1 * far);
    const h = this.half, unit = h / 100;
    this.root.replaceChildren();
    this.root.setAttribute("viewBox", `${-h} ${-h} ${2 * h} ${2 * h}`);
    const step = 10 ** Math.floor(Math.log10(h)) * (h / 10 ** Math.floor(Math.log10(h)) > 4 ? 1 : 0.5);
    for (let at = -Math.floor(h / step) * step; at <= h; at += step) {
      svg("path", { class: "grid", d: `M${at},${-h}V${h}M${-h},${at}H${h}`, "stroke-width": 0.3 * unit }, this.root);
    }
    const [x, y] = [hull[0] / 2, hull[1] / 2];
    svg("path", { class: "hull", d: `M${-y},${x}H${y}V${-x * 0.75}Q${y * 0.8},${-x} 0,${-x}Q${-y * 0.8},${-x} ${-y},${-x * 0.75}Z`, "stroke-width": unit, "stroke-dasharray": l ? "none" : 3 * unit }, this.root);
    svg("path", { class: "centre", d: `M${-3 * unit},0H${3 * unit}M0,${-3 * unit}V${3 * unit}`, "stroke-width": 0.8 * unit }, this.root);
    this.label(0, -x + 9 * unit, "bow", unit, "soft");
    this.label(h - 3 * unit, h - 4 * unit, `grid ${tidy(step, 2)} m`, unit, "soft", "end");
    thrusters.forEach((one) => this.thruster(one, unit));
    if (focused) this.root.querySelector(`[data-thruster="${CSS.escape(focused)}"]`)?.focus({ preventScroll: true });
  }

  label(x, y, text, unit, kind = "", anchor = "middle") {
    svg("text", { x, y, "font-size": 6.5 * unit, "text-anchor": anchor, class: kind }, this.root).textContent = text;
  }

  thruster(one, unit) {
    const group = svg("g", {
      class: `thruster ${one.arm > 0 ? "up" : one.arm < 0 ? "down" : ""} ${one.placed ? "" : "unplaced"}`,
      tabindex: 0,
      role: "button",
      "aria-roledescription": "thruster",
      "data-thruster": one.name,
      "aria-label": `${one.name}${one.placed ? "" : ", not placed yet"}: ${tidy(one.x, 3)} m ahead, ${tidy(one.y, 3)} m to starboard, pushes ${tidy(one.angle, 3)} degrees from the bow, arm ${tidy(one.arm, 3)} m`,
      transform: `translate(${one.y} ${-one.x})`,
    }, this.root);
    const arrow = svg("g", { class: "push", transform: `rotate(${one.angle})` }, group);
    svg("path", { d: `M0,0V${-17 * unit}`, "stroke-width": 2.6 * unit }, arrow);
    svg("path", { d: `M${-4 * unit},${-16 * unit}L0,${-25 * unit}L${4 * unit},${-16 * unit}Z`, stroke: "none" }, arrow);
    svg("circle", { r: 4.5 * unit, class: "body", "stroke-width": 1.6 * unit }, group);
    svg("circle", { r: 8.5 * unit, class: "ring", "stroke-width": 1.6 * unit }, group);
    svg("circle", { r: 11 * unit, fill: "transparent" }, group);
    const below = Math.cos(one.angle * RADIANS) > 0;
    const text = svg("text", { y: (below ? 13 : -8) * unit, "font-size": 6.5 * unit, "text-anchor": "middle" }, group);
    text.textContent = one.name;
    group.addEventListener("pointerdown", (event) => {
      this.held = one.name;
      // Drawing replaces the group, so the sketch itself captures the pointer.
      this.root.setPointerCapture(event.pointerId);
      group.focus({ preventScroll: true });
      event.preventDefault();
    });
    group.addEventListener("keydown", (event) => this.key(event, one));
  }

  drag(event) {
    if (!this.held) return;
    const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.root.getScreenCTM().inverse());
    const one = this.thrusters.find(({ name }) => name === this.held);
    if (one) this.moved(one.name, { ...one, x: rounded(-point.y), y: rounded(point.x) });
  }

  key(event, one) {
    const step = event.shiftKey ? 0.1 : 0.01;
    const MOVES = {
      ArrowUp: { x: one.x + step }, ArrowDown: { x: one.x - step }, ArrowRight: { y: one.y + step }, ArrowLeft: { y: one.y - step },
      ".": { angle: one.angle + 5 }, ",": { angle: one.angle - 5 }, ">": { angle: one.angle + 45 }, "<": { angle: one.angle - 45 },
    };
    const change = MOVES[event.key];
    if (!change || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    const next = { ...one, ...change };
    const angle = ((((next.angle + 180) % 360) + 360) % 360) - 180;
    this.moved(one.name, { x: rounded(next.x), y: rounded(next.y), angle });
  }
}

const rounded = (value) => Math.round(value * 1000) / 1000;
