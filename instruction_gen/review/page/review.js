"use strict";
const token = new URLSearchParams(location.search).get("token");
const $ = (id) => document.getElementById(id);
const state = { number: 0, text: 0, data: null, mode: "", played: 1 };
const style = document.createElement("link");
style.rel = "stylesheet";
style.href = "review.css?token=" + encodeURIComponent(token);
document.head.append(style);

async function call(path, body) {
  const url = path + (path.includes("?") ? "&" : "?") + "token=" + encodeURIComponent(token);
  const answer = await fetch(url, body === undefined ? {} : { method: "POST", body: JSON.stringify(body) });
  const value = await answer.json().catch(() => ({}));
  if (!answer.ok) throw new Error(value.error || answer.status);
  return value;
}

function say(words) { $("message").textContent = words; }

function element(name, className, text) {
  const made = document.createElement(name);
  made.className = className;
  if (text !== undefined) made.textContent = text;
  return made;
}

// While a path loads, keys and buttons do nothing: they would judge the one before it.
function busy(loading) {
  state.loading = loading;
  for (const button of document.querySelectorAll("nav button")) button.disabled = loading;
}

async function load(number) {
  const who = encodeURIComponent($("annotator").value.trim());
  busy(true);
  try {
    state.data = await call(`api/path?number=${number}&annotator=${who}`);
  } catch (error) {
    say(String(error.message));
    return;
  } finally {
    busy(false);
  }
  state.number = state.data.number;
  state.text = Math.min(state.text, state.data.texts.length - 1);
  state.mode = "";
  show();
  play();
}

function show() {
  const data = state.data;
  $("title").textContent = `${data.name} (${data.number + 1} of ${data.paths})`;
  const both = data.agreement;
  $("progress").max = data.texts_in_all;
  $("progress").value = both.judged;
  for (const key of "ar") document.querySelector(`nav [data-key="${key}"]`).hidden = data.written;
  $("agreement").textContent = data.written ? `${both.judged} of ${data.texts_in_all} have a text` : `${both.judged} of ${data.texts_in_all} judged, ${both.agreed} of ${both.judged_twice} judged twice agree`;
  $("facts").replaceChildren(...data.facts.map((line) => element("li", "", line)));
  const film = $("film");
  film.hidden = !data.film;
  if (data.film) film.src = `api/film?name=${encodeURIComponent(data.name)}&token=${encodeURIComponent(token)}`;
  else film.removeAttribute("src");
  $("texts").replaceChildren(...data.texts.map(card));
}

function card(text, number) {
  const box = element("div", `text ${text.own}` + (number === state.text ? " current" : ""));
  box.tabIndex = 0;
  box.setAttribute("aria-current", number === state.text);
  box.onfocus = () => { if (!state.mode && state.text !== number) { state.text = number; show(); $("texts").children[number].focus(); } };
  box.onclick = () => { if (state.text !== number) { state.text = number; state.mode = ""; show(); } };
  if (number === state.text && state.mode === "edit") {
    const area = element("textarea", "");
    area.value = text.text;
    const verdict = element("div", "problems");
    let wait = 0;
    area.oninput = () => {
      clearTimeout(wait);
      wait = setTimeout(async () => {
        const found = await call("api/check", { path: state.data.name, number, text: area.value });
        verdict.textContent = found.problems.join(" · ");
        verdict.dataset.checked = area.value;
      }, 120);
    };
    area.onkeydown = (event) => {
      event.stopPropagation();
      if (event.key === "Enter" && !event.shiftKey) { event.preventDefault(); decide("edit", { text: area.value }); }
      if (event.key === "Escape") { state.mode = ""; show(); }
    };
    box.append(area, verdict);
    setTimeout(() => area.focus());
    return box;
  }
  const line = element("div", "line");
  line.append(`${number + 1}. `);
  let at = 0;
  for (const [start, stop, problems] of text.verdict.clauses) {
    if (start > at) line.append(text.text.slice(at, start));
    const part = element("span", "clause" + (problems.length ? " bad" : ""), text.text.slice(Math.max(at, start), stop));
    part.title = problems.join("; ");
    line.append(part);
    at = Math.max(at, stop);
  }
  line.append(text.text.slice(at));
  box.append(line);
  if (text.verdict.problems.length) box.append(element("div", "problems", text.verdict.problems.join(" · ")));
  const loose = text.verdict.unchecked;
  if (loose.length && !text.own) box.append(element("div", "problems", `unchecked: ${loose.join(", ")}. It is exported only if you accept it.`));
  const status = [text.own && `you: ${text.own}` + (text.reason ? ` (${text.reason})` : ""), text.others.length && `others: ${text.others.join(", ")}`];
  box.append(element("div", "status", status.filter(Boolean).join(" — ")));
  if (number === state.text && state.mode === "reject") {
    const reason = element("input", "reason");
    reason.placeholder = "reason, then Enter";
    reason.onkeydown = (event) => {
      event.stopPropagation();
      if (event.key === "Enter" && reason.value.trim()) decide("reject", { reason: reason.value.trim() });
      if (event.key === "Escape") { state.mode = ""; show(); }
    };
    box.append(reason);
    setTimeout(() => reason.focus());
  }
  return box;
}

async function decide(action, more) {
  const annotator = $("annotator").value.trim();
  if (!annotator) { say("your name first, please"); $("annotator").focus(); return; }
  if (state.loading) return;
  busy(true);
  try {
    await call("api/decide", { annotator, path: state.data.name, number: state.text, action, ...more });
    say(`${action}: kept`);
    await load(state.number);
  } catch (error) { say(String(error.message)); } finally { busy(false); }
}

for (const button of document.querySelectorAll("nav button")) button.onclick = () => press(button.dataset.key);
document.addEventListener("keydown", (event) => {
  if (event.target.tagName === "INPUT" || event.target.tagName === "TEXTAREA") return;
  if (event.target.tagName === "BUTTON" && (event.key === " " || event.key === "Enter")) return;
  if (press(event.key)) event.preventDefault();
});

/* Do what a key says; return whether the browser must not. */
function press(key) {
  if (state.loading || !state.data || (state.data.written && "ar".includes(key))) return false;
  if (key >= "1" && key <= "9" && state.data && +key <= state.data.texts.length) { state.text = +key - 1; state.mode = ""; show(); }
  else if (key === "a") decide("accept", {});
  else if (key === "e") { state.mode = "edit"; show(); return true; }
  else if (key === "r") { state.mode = "reject"; show(); return true; }
  else if (key === "u") decide("undo", {});
  else if (key === "n") { state.text = 0; load((state.number + 1) % state.data.paths); }
  else if (key === "p") { state.text = 0; load((state.number + state.data.paths - 1) % state.data.paths); }
  else if (key === "j" && state.data.next_unjudged < 0) say("every text is judged");
  else if (key === "j") { state.text = 0; load(state.data.next_unjudged); }
  else if (key === " ") { play(); return true; }
  return false;
}
$("annotator").onchange = () => load(state.number);

let frame = 0;
function play() {
  cancelAnimationFrame(frame);
  const film = $("film");
  const start = performance.now();
  if (state.data.film) film.play().catch(() => {});
  const step = (now) => {
    const share = state.data.film && film.duration ? film.currentTime / film.duration : (now - start) / 4000;
    draw(Math.max(0, Math.min(1, share)));
    if (share < 1) frame = requestAnimationFrame(step);
  };
  frame = requestAnimationFrame(step);
}

function draw(share) {
  const canvas = $("map"), pen = canvas.getContext("2d"), data = state.data;
  const xs = data.path.map((p) => p[0]), ys = data.path.map((p) => p[1]);
  const low = [Math.min(...xs) - 2, Math.min(...ys) - 2], high = [Math.max(...xs) + 2, Math.max(...ys) + 2];
  const scale = Math.min(canvas.width / (high[0] - low[0]), canvas.height / (high[1] - low[1]));
  const X = (x) => (x - low[0]) * scale, Y = (y) => canvas.height - (y - low[1]) * scale;
  pen.fillStyle = "#cfd4dc";
  pen.fillRect(0, 0, canvas.width, canvas.height);
  pen.fillStyle = "#ffffff";
  const { origin, cell, rows } = data.walls;
  rows.forEach((row, r) => {
    for (let c = 0; c < row.length; c++) {
      if (row[c] === "1") pen.fillRect(X(origin[0] + c * cell), Y(origin[1] + (r + 1) * cell), cell * scale + 1, cell * scale + 1);
    }
  });
  pen.font = "12px system-ui";
  for (const thing of data.things) {
    const width = (thing.high[0] - thing.low[0]) * scale, height = (thing.high[1] - thing.low[1]) * scale;
    pen.fillStyle = thing.noun === "doorway" ? "#f0e2b6" : "#dfe7f3";
    pen.fillRect(X(thing.low[0]), Y(thing.high[1]), width, height);
    pen.fillStyle = "#334";
    if (!/doorway|lamp|rug/.test(thing.noun) && width > 14) pen.fillText(thing.noun, X(thing.low[0]) + 2, Y(thing.high[1]) + 12);
  }
  pen.font = "bold 14px system-ui";
  pen.textAlign = "center";
  pen.fillStyle = "#8a4b08";
  for (const room of data.rooms) pen.fillText(room.name, X(room.at[0]), Y(room.at[1]));
  pen.textAlign = "left";
  pen.lineWidth = 3;
  const last = share * (data.path.length - 1);
  for (const [colour, until] of [["#b9c6dd", data.path.length - 1], ["#2667c9", last]]) {
    pen.strokeStyle = colour;
    pen.beginPath();
    data.path.forEach((p, k) => { if (k <= until) { if (k) pen.lineTo(X(p[0]), Y(p[1])); else pen.moveTo(X(p[0]), Y(p[1])); } });
    pen.stroke();
  }
  const dot = (p, colour) => { pen.fillStyle = colour; pen.beginPath(); pen.arc(X(p[0]), Y(p[1]), 6, 0, 7); pen.fill(); };
  dot(data.path[0], "#2a8f4a");
  const goal = data.path[data.path.length - 1];
  dot(goal, "#c0392b");
  pen.fillText("goal", X(goal[0]) + 9, Y(goal[1]) + 4);
  dot(data.path[Math.floor(last)], "#2667c9");
}

load(0);
