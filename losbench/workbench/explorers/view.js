// The picture of an explorer, with handles over it. One question to the kernel is under way; of what
// comes in between only the latest waits, so that the picture stands still when the hand does.
const PATIENCE_MS = 3000, QUIET_MS = 250, SHARPEST = 2;
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
  const refused = make(el, "div", "refused", "alert");
  let underway = null, waiting = {}, patience, quiet, seen = "", width = 0;

  const send = () => {
    if (underway || !Object.keys(waiting).length) return;
    underway = { ...waiting, id: `${Math.random()}` };
    waiting = {};
    const asked = () => { model.send(underway); patience = setTimeout(asked, PATIENCE_MS); };
    asked();
  };
  const ask = (part) => { Object.assign(waiting, part); send(); };

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
      const [x, y] = waiting.steps?.[k] ?? [0, 0], [dx, dy] = ARROWS[event.key], times = event.shiftKey ? 10 : 1;
      ask({ steps: { ...waiting.steps, [k]: [x + times * dx, y + times * dy] } });
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
  const answered = () => {
    if (!underway || model.get("answered") !== underway.id) return;
    clearTimeout(patience);
    underway = null;
    place();
    send();
  };
  const look = () => {
    width = stage.clientWidth || width;  // a change of theme hides the page for a moment
    const asked = {
      width,
      ratio: Math.min(devicePixelRatio || 1, SHARPEST),
      light: document.body.dataset.jpThemeLight !== "false",
    };
    if (!width || seen === JSON.stringify(asked)) return;
    seen = JSON.stringify(asked);
    ask({ look: asked });
  };

  // A slider's own readout would pull what is out of range to the nearest end, and say nothing.
  const typed = (event) => {
    const readout = event.target, ends = readout.parentElement?.querySelector(".noUi-handle");
    if (!ends || readout.contentEditable !== "true" || (event.type === "keydown" && event.key !== "Enter")) return;
    const [low, high, now] = ["min", "max", "now"].map((name) => Number(ends.getAttribute(`aria-value${name}`)));
    const value = Number(readout.textContent.replace("−", "-"));
    if (!(value < low || value > high)) return;
    event.stopPropagation();
    event.preventDefault();
    const digits = (readout.dataset.before ?? "").split(".")[1]?.length ?? 0;
    readout.textContent = readout.dataset.before || now.toFixed(digits);
    const name = readout.parentElement.querySelector(".widget-label")?.textContent ?? "";
    refused.textContent = `Note: ${name}: ${value < low ? `${low} is the least` : `${high} is the most`}, got ${value}`;
  };
  const remember = ({ target }) => { if (target.contentEditable === "true") target.dataset.before = target.textContent; };
  const listen = () => {
    const box = el.closest(".losbench-explorer");
    if (!box || box.dataset.losbench) return;
    box.dataset.losbench = "listens";
    box.addEventListener("focus", remember, true);
    for (const kind of ["keydown", "blur"]) box.addEventListener(kind, typed, true);
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
  const follow = { "change:png": draw, "change:handles": place, "change:answered": answered };
  Object.entries(follow).forEach(([name, act]) => model.on(name, act));
  const sizes = new ResizeObserver(() => { listen(); look(); });
  const theme = new MutationObserver(look);
  sizes.observe(el);
  theme.observe(document.body, { attributes: true, attributeFilter: ["data-jp-theme-light"] });
  draw();
  place();
  return () => {
    Object.entries(follow).forEach(([name, act]) => model.off(name, act));
    sizes.disconnect();
    theme.disconnect();
    [patience, quiet].forEach(clearTimeout);
    URL.revokeObjectURL(image.src);
  };
}

export default { render };
