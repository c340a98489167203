// Shared tools of the page: elements, numbers and requests to the server, which runs on this machine.

export const byId = (id) => document.getElementById(id);

export function element(name, text = "", parent = null, attributes = {}) {
  const made = document.createElement(name);
  made.textContent = text;
  for (const [key, value] of Object.entries(attributes)) {
    if (key in made && typeof value !== "string") made[key] = value;
    else made.setAttribute(key, value);
  }
  parent?.append(made);
  return made;
}

export const tidy = (value, digits = 4) => String(+value.toPrecision(digits)).replace("-", "−");

// Parse a number; a decimal comma and a true minus sign are accepted. null for an empty field, NaN for other text.
export function typed(text) {
  const plain = text.trim().replace("−", "-").replace(",", ".");
  return plain === "" ? null : Number(plain);
}

export async function ask(path, { body, raw, signal } = {}) {
  const options = { signal, cache: "no-store" };
  if (body !== undefined) {
    Object.assign(options, { method: "POST", body: JSON.stringify(body), headers: { "Content-Type": "application/json" } });
  }
  if (raw !== undefined) Object.assign(options, { method: "POST", body: raw });
  let answer;
  try {
    answer = await fetch(`api/${path}`, options);
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Error("rovid does not answer. Check that `rovid open` is still running in its terminal.");
  }
  const document = await answer.json().catch(() => ({}));
  if (!answer.ok) throw new Error(document.error ?? `rovid refused the request (status ${answer.status}).`);
  return document;
}

// Debounce: call `act` once no call came for this many ms. A call that is still running is aborted.
export function soon(act, quiet) {
  let timer, running;
  return () => {
    clearTimeout(timer);
    timer = setTimeout(async () => {
      running?.abort();
      const own = (running = new AbortController());
      try {
        await act(own.signal);
      } catch (error) {
        if (error.name !== "AbortError") throw error;
      }
    }, quiet);
  };
}

export function hear(text) {
  byId("heard").textContent = text;
}

export async function copy(text, button) {
  const was = button.textContent;
  try {
    await navigator.clipboard.writeText(text);
    button.textContent = "Copied";
  } catch {
    button.textContent = "Not copied";
  }
  hear(button.textContent);
  setTimeout(() => { button.textContent = was; }, 1500);
}

// Whether a log's name matches `pattern`, with *, ? and [...] as in rovid.toml.
export function isOf(name, pattern) {
  const parts = pattern.match(/\[!?\]?[^\]]*\]|[\s\S]/g) ?? [];
  const text = parts.map((part) => {
    if (part === "*") return "[\\s\\S]*";
    if (part === "?") return "[\\s\\S]";
    if (part.length > 1) return part.replace(/^\[!/, "[^").replace(/\\/g, "\\\\");
    return part.replace(/[.*+?^${}()|[\]\\]/g, "\\$&");
  }).join("");
  try {
    const whole = new RegExp(`^${text}$`);
    return whole.test(name) || whole.test(name.split("/").pop());
  } catch {
    return name === pattern;
  }
}

// A pattern that matches this log only.
export const literally = (name) => name.replace(/[[*?]/g, "[$&]");
