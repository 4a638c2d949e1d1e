"use strict";
/* Filters, buttons and keys of the page. */
(() => {
  const one = (id) => document.getElementById(id);
  if (!one("view")) return;
  const player = new Player(one("view"));
  if (!player.gl) { one("no-webgl").hidden = false; one("view").hidden = true; }
  const all = Array.from(document.querySelectorAll(".motion"));
  const filters = ["object", "verdict", "outcome", "generator"];
  const state = { idx: -1, plays: false, last: 0, loading: null };
  window.report = { player, state, select, load, draw: () => player.draw() };

  /* The file of a motion: text, gzip, glTF. */
  async function load(idx) {
    const bytes = Uint8Array.from(atob(one(`glb-${idx}`).textContent), (letter) => letter.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Glb(await new Response(stream).arrayBuffer());
  }

  function shown() { return all.filter((button) => !button.parentElement.hidden); }

  async function select(idx, plays) {
    const button = all[idx];
    if (!button) return;
    state.idx = idx;
    all.forEach((other) => other.setAttribute("aria-current", String(other === button)));
    const loading = load(idx);
    state.loading = loading;
    const glb = await loading;
    if (state.loading !== loading) return;
    player.show(glb);
    one("scrub").max = String(glb.duration);
    const { id, object, verdict, outcome, generator, recording } = button.dataset;
    const name = one("motion-name");
    name.textContent = `${id}: ${verdict.replaceAll("_", " ")} (${outcome}, ${generator}, ${object}) `;
    if (recording) {
      const link = document.createElement("a");
      link.href = recording;
      link.textContent = "recording";
      name.append(link);
    }
    seek(0);
    play(plays);
  }

  function seek(time) {
    const duration = player.glb ? player.glb.duration : 0;
    player.time = Math.min(Math.max(time, 0), duration);
    one("scrub").value = String(player.time);
    one("time").textContent = `${player.time.toFixed(2)} of ${duration.toFixed(2)} s`;
    player.draw();
  }

  function play(plays) {
    if (plays && player.glb && player.time >= player.glb.duration) seek(0);
    state.plays = plays;
    one("play").textContent = plays ? "Pause" : "Play";
    state.last = 0;
    if (plays) requestAnimationFrame(frame);
  }

  function frame(now) {
    if (!state.plays || !player.glb) return;
    const passed = state.last ? (now - state.last) / 1000 : 0;
    state.last = now;
    const time = player.time + passed * Number(one("speed").value);
    seek(time);
    if (time >= player.glb.duration) play(false);
    else requestAnimationFrame(frame);
  }

  function step(by) {
    const buttons = shown();
    if (!buttons.length) return;
    const at = buttons.indexOf(all[state.idx]);
    const next = buttons[(at + by + buttons.length) % buttons.length];
    next.scrollIntoView({ block: "nearest" });
    select(Number(next.dataset.idx), state.plays);
  }

  function filter() {
    const wanted = filters.map((name) => [name, one(`filter-${name}`).value]);
    for (const button of all)
      button.parentElement.hidden = wanted.some(([name, value]) => value && button.dataset[name] !== value);
    const buttons = shown();
    one("shown-count").textContent = `${buttons.length} of ${all.length} motions`;
    if (buttons.length && !buttons.includes(all[state.idx])) select(Number(buttons[0].dataset.idx), false);
  }

  all.forEach((button) => button.addEventListener("click", () => select(Number(button.dataset.idx), true)));
  filters.forEach((name) => one(`filter-${name}`).addEventListener("change", filter));
  document.querySelectorAll("[data-filter]").forEach((link) => link.addEventListener("click", () => {
    const { filter: name, value } = link.dataset;
    const select = one(`filter-${name}`);
    filters.forEach((other) => { one(`filter-${other}`).value = ""; });
    const has = Array.from(select.options).some((option) => option.value === value);
    if (has) select.value = value;
    filter();
    if (!has) one("shown-count").textContent = `no recorded motion of ${value.replaceAll("_", " ")}; showing all`;
    one("motions").scrollIntoView();
    const first = shown()[0];
    if (first) window.report.select(Number(first.dataset.idx), has);
  }));
  one("previous").addEventListener("click", () => step(-1));
  one("next").addEventListener("click", () => step(1));
  one("play").addEventListener("click", () => play(!state.plays));
  one("scrub").addEventListener("input", (event) => { play(false); seek(Number(event.target.value)); });
  one("ghost").addEventListener("change", (event) => { player.hidden.ghost = !event.target.checked; player.draw(); });
  one("contacts").addEventListener("change", (event) => { player.hidden.contact = !event.target.checked; player.draw(); });
  one("follow").addEventListener("change", (event) => { player.follow = event.target.checked; player.draw(); });
  one("camera").addEventListener("change", (event) => {
    const views = { oblique: [0.9, 0.45], front: [1.571, 0.12], side: [0, 0.12], top: [0, 1.5] };
    [player.camera.turn, player.camera.rise] = views[event.target.value];
    player.draw();
  });
  window.addEventListener("resize", () => player.draw());

  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const tag = event.target.tagName;
    if (tag === "SELECT" || tag === "INPUT" && event.target.type !== "checkbox") return;
    const actions = { n: () => step(1), p: () => step(-1), ",": () => { play(false); seek(player.time - 0.02); },
      ".": () => { play(false); seek(player.time + 0.02); } };
    if (tag !== "BUTTON" && tag !== "A" && tag !== "INPUT") actions[" "] = () => play(!state.plays);
    if (event.target === player.canvas) {
      const turn = (turn, rise) => () => {
        player.camera.turn += turn;
        player.camera.rise = Math.min(Math.max(player.camera.rise + rise, -0.2), 1.55);
        player.draw();
      };
      Object.assign(actions, { ArrowLeft: turn(-0.1, 0), ArrowRight: turn(0.1, 0), ArrowUp: turn(0, 0.1), ArrowDown: turn(0, -0.1) });
    }
    const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (action) { event.preventDefault(); action(); }
  });

  /* Dragging turns the view, or shifts it; two fingers zoom. */
  const pointers = new Map();
  player.canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  player.canvas.addEventListener("pointerdown", (event) => {
    player.canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
  });
  for (const end of ["pointerup", "pointercancel"])
    player.canvas.addEventListener(end, (event) => pointers.delete(event.pointerId));
  player.canvas.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const span = () => { const [a, b] = Array.from(pointers.values()); return Math.hypot(a[0] - b[0], a[1] - b[1]); };
    const camera = player.camera, [dx, dy] = [event.clientX - before[0], event.clientY - before[1]];
    const old = pointers.size === 2 ? span() : 0;
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    if (old > 0) camera.distance = Math.min(Math.max(camera.distance * old / span(), 0.1), 3);
    else if (event.shiftKey || event.buttons === 2) {
      player.follow = one("follow").checked = false;
      const size = camera.distance / player.canvas.clientHeight;
      camera.target = [camera.target[0] - size * dx * Math.cos(camera.turn), camera.target[1] + size * dy,
        camera.target[2] + size * dx * Math.sin(camera.turn)];
    } else {
      camera.turn -= 0.008 * dx;
      camera.rise = Math.min(Math.max(camera.rise + 0.008 * dy, -0.2), 1.55);
    }
    player.draw();
  });
  player.canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    player.camera.distance = Math.min(Math.max(player.camera.distance * Math.exp(0.001 * event.deltaY), 0.1), 3);
    player.draw();
  }, { passive: false });

  filter();
})();
