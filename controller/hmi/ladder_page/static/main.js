// The ladder page: scans from the server, their views, and the parts of the page.

import { write } from "./dom.js";
import { Charts } from "./charts.js";
import { Ladder } from "./ladder.js";
import { MachineView } from "./machine.js";
import { Panel } from "./panel.js";
import { Run } from "./run.js";
import { ask, otherLanguage, t, unknown, useTexts } from "./texts.js";

const PERIOD_MS = 250;
const STALE_MS = 1500; // values that are older are outdated
const NARROW = 1000; // px, below which the panel covers the ladder

const of = (id) => document.getElementById(id);
let view = "end";
let frozen = null; // number of the frozen scan
let link = "starting"; // live, frozen, starting, lost, gone, recorded
let heard = 0; // time of the last scan, ms
let asking = false;
let again = false; // another request follows the present one
let keeping = false; // the next request freezes the scan
let latest = null;
let track = null; // recorded run or branch that is shown; null = the program is live
let shown = "ladder"; // or charts, machine
let ladder, panel, charts, machine, description, run;

async function begin() {
  ladder = new Ladder((devices) => chosen(devices[0]), () => look());
  let answer = { status: 0 };
  while (answer.status !== 200) {
    answer = await ask("/api/describe", { columns: ladder.columns() });
    if (answer.status !== 200) await new Promise((done) => { window.setTimeout(done, PERIOD_MS); });
  }
  description = answer.body;
  useTexts(description.texts);
  document.title = description.name;
  track = description.live ? null : "recorded";
  if (!description.live) run = new Run(moved, () => panel.device);
  of("freeze").hidden = !description.live;
  if (description.picture) machine = new MachineView();
  document.querySelector("[data-mode=machine]").hidden = !machine;
  charts = new Charts([...description.charts], chosen);
  panel = new Panel(description, jump, () => frozen, run ? { run: (part) => run.fill(part) } : {});
  listen();
  mode("ladder");
  side(window.innerWidth >= NARROW);
  ladder.take(description, ladder.columns());
  if (run) await run.begin();
  status();
  window.setInterval(tick, PERIOD_MS);
}

function tick() {
  if (frozen === null && !document.hidden) look();
  else if (frozen !== null && ["lost", "starting"].includes(link)) look();
  status();
}

/** Ask for the scan that is shown; of requests during another one, the last is made after it. */
async function look() {
  if (asking) {
    again = true;
    return;
  }
  asking = true;
  const keep = keeping;
  keeping = false;
  const [first, count] = ladder.span();
  const wanted = { view, first, count, ...(keep ? { keep: 1 } : frozen === null ? {} : { scan: frozen }),
    ...(shown === "machine" ? { machine: 1 } : {}) };
  const { status: code, body } = await ask("/api/look", wanted);
  asking = false;
  if (code === 200) {
    if (keep) frozen = body.scan;
    if (wanted.view === view && (frozen === null || frozen === body.scan)) apply(body);
  } else {
    link = body.state;
  }
  status();
  if (again) {
    again = false;
    look();
  }
}

function apply(body) {
  heard = performance.now();
  link = track ?? (frozen === null ? "live" : "frozen");
  latest = body;
  write(of("scan"), String(body.scan));
  write(of("time"), `${(body.at_ms / 1000).toFixed(2)} s`);
  document.body.dataset.shown = `${body.view} ${body.scan}`;
  ladder.apply(body);
  if (body.machine) machine.show(body.machine);
  const active = new Set(body.active);
  panel.show(active);
  charts.show(active);
}

function status() {
  if (link === "live" && performance.now() - heard > STALE_MS) link = "lost";
  document.body.dataset.link = link;
  write(of("state"), t(`state.${link}`));
  write(of("freeze"), t(frozen === null ? "freeze" : "live"));
  of("freeze").setAttribute("aria-pressed", String(frozen !== null));
  let message = ["lost", "gone", "starting"].includes(link) ? t(`state.${link}`) : "";
  if (message === "" && latest && !latest.known) {
    message = unknown(latest);
  }
  of("message").hidden = message === "";
  write(of("message"), message);
  document.querySelectorAll("[data-view]").forEach((each) => each.setAttribute("aria-pressed", String(each.dataset.view === view)));
}

/** The position in the recorded run is another one: after a scan, or before a rung of the next scan. */
function moved(scan, shown, rung) {
  frozen = rung === null ? scan : scan + 1;
  track = shown;
  if (rung === null) ladder.mark(null);
  else {
    view = "executed"; // END values are those of a complete scan
    mode("ladder");
    ladder.jump(rung);
  }
  look();
}

function freeze() {
  if (track !== null) return;
  if (frozen === null) {
    keeping = true;
  } else {
    frozen = null;
  }
  look();
}

function show(name) {
  view = name;
  status();
  look();
}

function mode(name) {
  document.querySelectorAll("[data-mode]").forEach((each) => each.setAttribute("aria-pressed", String(each.dataset.mode === name)));
  of("ladder").hidden = name !== "ladder";
  of("charts").hidden = name !== "charts";
  of("machine").hidden = name !== "machine";
  shown = name;
  if (name === "charts") charts.open();
  if (name === "machine") {
    machine.open();
    look();
  }
  if (name === "ladder" && ladder.used) resize(); // it has no width while it is hidden
}

function side(open) {
  document.body.classList.toggle("with-panel", open);
  of("side").setAttribute("aria-pressed", String(open));
}

function chosen(device) {
  side(true);
  panel.choose(device);
}

function jump(rung) {
  mode("ladder");
  ladder.jump(rung);
  if (window.innerWidth < NARROW) side(false);
}

async function resize() {
  if (shown !== "ladder") {
    machine?.relabel();
    return;
  }
  const columns = ladder.columns();
  if (columns === ladder.used) {
    ladder.place();
    return;
  }
  const { status: code, body } = await ask("/api/describe", { columns });
  if (code === 200) ladder.take(body, columns);
}

function listen() {
  document.querySelectorAll("[data-view]").forEach((each) => each.addEventListener("click", () => show(each.dataset.view)));
  document.querySelectorAll("[data-mode]").forEach((each) => each.addEventListener("click", () => mode(each.dataset.mode)));
  of("freeze").addEventListener("click", freeze);
  of("smaller").addEventListener("click", () => ladder.scale(1 / 1.25));
  of("larger").addEventListener("click", () => ladder.scale(1.25));
  of("side").addEventListener("click", () => side(!document.body.classList.contains("with-panel")));
  of("language").addEventListener("click", () => {
    otherLanguage();
    panel.refresh();
    run?.label();
    machine?.relabel();
    status();
  });
  of("search").addEventListener("input", (event) => {
    side(true);
    panel.seek(event.target.value);
  });
  window.addEventListener("resize", resize);
  document.addEventListener("keydown", (event) => {
    if (event.target.matches("input")) return;
    if (event.key === "/") {
      event.preventDefault();
      of("search").focus();
    } else if (event.key === "f") freeze();
    else if (event.key === "v") show(view === "end" ? "executed" : "end");
    else if (event.key === "Escape") side(false);
  });
}

begin();
