// The steps of the page: one is shown, and a bar that stays leads to each.
import { byId } from "./tools.js";

const buttons = [...document.querySelectorAll("#steps button")];
const STATES = { done: " ✓", open: " !", "": "" };

export let step = "logs";

// Show a step, and focus a place in it: an element, its id, or a function that finds it.
export function go(name, at = null) {
  step = name;
  for (const section of document.querySelectorAll(".step")) section.hidden = section.id !== name;
  for (const button of buttons) {
    if (button.dataset.step === name) button.setAttribute("aria-current", "step");
    else button.removeAttribute("aria-current");
  }
  const found = typeof at === "function" ? at() : at;
  const there = typeof found === "string" ? byId(found) : found;
  if (!there) return scrollTo(0, 0);
  for (let outer = there.closest("details"); outer; outer = outer.parentElement.closest("details")) outer.open = true;
  there.focus({ preventScroll: true });
  there.scrollIntoView({ block: "center" });
  return undefined;
}

// Mark a step as done, as open (something is asked for), or as neither.
export function mark(name, state) {
  const button = buttons.find((each) => each.dataset.step === name);
  const words = { done: "done", open: "something is open" }[state];
  button.dataset.state = state;
  button.dataset.mark = STATES[state];
  if (words) button.setAttribute("aria-label", `${button.textContent}: ${words}`);
  else button.removeAttribute("aria-label");
}

for (const button of buttons) button.addEventListener("click", () => go(button.dataset.step));
