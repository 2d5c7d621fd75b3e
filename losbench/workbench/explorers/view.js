// The picture of an explorer, with handles over it. One question to the kernel is under way; of what
// comes in between only the latest waits, so that the picture stands still when the hand does.
const PATIENCE_MS = 3000, QUIET_MS = 200, SHARPEST = 2;
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

const make = (parent, tag, name, role = null) => {
  const made = parent.appendChild(document.createElement(tag));
  made.className = `losbench-${name}`;
  if (role) made.setAttribute("role", role);
  return made;
};
const put = (button, x, y) => Object.assign(button.style, { left: `${100 * x}%`, top: `${100 * y}%` });
const within = (share) => Math.min(1, Math.max(0, share));

function render({ model, el }) {
  const stage = make(el, "div", "stage"), image = make(stage, "img", "picture"), buttons = [];
  const copy = make(el, "button", "copy"), said = make(el, "span", "said", "status");
  const refused = make(el, "div", "refused", "alert"), ended = new AbortController();
  let underway = null, waiting = {}, patience, quiet, seen = "", width = 0;

  const ask = (part) => {
    Object.assign(waiting, part);
    if (underway || !Object.keys(waiting).length) return;
    underway = { ...waiting, id: `${Math.random()}` };
    waiting = {};
    model.send(underway);
    patience = setInterval(() => model.send(underway), PATIENCE_MS);
  };
  const answered = () => {
    if (model.get("answered") !== underway?.id) return;
    clearInterval(patience);
    underway = null;
    place();
    ask();
  };

  const handle = (k) => {
    const button = make(stage, "button", "handle", "slider");
    button.onpointerdown = (event) => {
      event.preventDefault();
      button.focus();
      button.setPointerCapture(event.pointerId);
      button.held = true;
    };
    button.onpointermove = (event) => {
      if (!button.held) return;
      const box = stage.getBoundingClientRect();
      const at = [within((event.clientX - box.left) / box.width), within((event.clientY - box.top) / box.height)];
      put(button, ...at);
      ask({ moves: { ...waiting.moves, [k]: at } });
    };
    button.onlostpointercapture = () => { button.held = false; if (!underway) place(); };
    button.onkeydown = (event) => {
      if (!(event.key in ARROWS)) return;
      event.preventDefault();
      const before = waiting.steps?.[k] ?? [0, 0], times = event.shiftKey ? 10 : 1;
      ask({ steps: { ...waiting.steps, [k]: ARROWS[event.key].map((by, n) => before[n] + times * by) } });
    };
    return button;
  };
  const place = () => {
    const wanted = model.get("handles");
    while (buttons.length > wanted.length) buttons.pop().remove();
    while (buttons.length < wanted.length) buttons.push(handle(buttons.length));
    wanted.forEach(({ x, y, label, text, now }, k) => {
      const words = { "aria-label": label, "aria-valuetext": text, "aria-valuenow": now, title: label };
      Object.entries(words).forEach(([name, value]) => buttons[k].setAttribute(name, value));
      if (!buttons[k].held) put(buttons[k], x, y);
    });
  };
  const draw = () => {
    URL.revokeObjectURL(image.src);
    image.src = URL.createObjectURL(new Blob([model.get("png")], { type: "image/png" }));
    image.alt = model.get("alt");
    refused.textContent = said.textContent = "";
    clearTimeout(quiet);
    if (model.get("coarse")) quiet = setTimeout(() => ask({ settle: true }), QUIET_MS);
  };
  const look = () => {
    width = stage.clientWidth || width;  // a change of theme hides the page for a moment
    const ratio = Math.min(devicePixelRatio || 1, SHARPEST);
    const asked = { width, ratio, light: document.body.dataset.jpThemeLight !== "false" };
    if (!width || seen === JSON.stringify(asked)) return;
    seen = JSON.stringify(asked);
    ask({ look: asked });
  };

  // A slider would pull what is typed out of range to the nearest end, and say nothing; what is no
  // number it puts back itself.
  const typed = ({ target, type, key }) => {
    const row = el.closest(".losbench-explorer")?.contains(target) && target.parentElement;
    const ends = target.contentEditable === "true" && row && row.querySelector(".noUi-handle");
    if (!ends || (type === "keydown" && key !== "Enter")) return;
    const [low, high] = ["min", "max"].map((name) => Number(ends.getAttribute(`aria-value${name}`)));
    const value = Number(target.textContent.replace("−", "-"));
    if (!(value < low || value > high)) return;
    target.textContent = "out of range";
    const name = row.querySelector(".widget-label")?.textContent ?? "";
    refused.textContent = `Note: ${name}: ${value < low ? `${low} is the least` : `${high} is the most`}, got ${value}`;
  };

  image.draggable = false;
  copy.textContent = "copy as code";
  copy.onclick = async () => {
    try {
      await navigator.clipboard.writeText(model.get("code"));
      said.textContent = "copied";
    } catch {  // without the right to the clipboard: shown, and selected
      const shown = el.querySelector("textarea") ?? make(el, "textarea", "code");
      shown.value = model.get("code");
      shown.select();
      said.textContent = document.execCommand("copy") ? "copied" : "press Ctrl+C";
    }
  };
  for (const kind of ["keydown", "blur"])
    document.addEventListener(kind, typed, { capture: true, signal: ended.signal });
  model.on("change:png", draw);
  model.on("change:handles", place);
  model.on("change:answered", answered);
  const sizes = new ResizeObserver(look), theme = new MutationObserver(look);
  sizes.observe(el);
  theme.observe(document.body, { attributes: true, attributeFilter: ["data-jp-theme-light"] });
  draw();
  place();
  return () => {
    ended.abort();
    model.off();
    [sizes, theme].forEach((observer) => observer.disconnect());
    [patience, quiet].forEach(clearTimeout);
    URL.revokeObjectURL(image.src);
  };
}

export default { render };
