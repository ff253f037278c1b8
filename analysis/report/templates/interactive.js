"use strict";
// The page's values, as analysis/report/interactive.py writes them; here they are drawn, and nothing is computed.
const page = JSON.parse(document.getElementById("data").textContent);
const {colours, panels, labels} = page.style;
const byId = id => document.getElementById(id);
const series = byId("series"), track = byId("track"), readout = byId("readout");
const channel = name => page.channels[name] || [];
const drawn = (name, data = page) => data.drawn[name] || data.channels[name] || [];  // angles run on beyond the turn
const ROWS = page.time_s.length;
const END_S = page.time_s[ROWS - 1];
const state = {row: 0, from: 0, to: END_S, hidden: new Set()};

// --- time: seconds since the first row inside, UTC text for plotly and for people

const milliseconds = seconds => page.start_ms + Math.round(1000 * seconds);
const stamp = seconds => new Date(milliseconds(seconds)).toISOString().slice(0, 23).replace("T", " ");
const clock = seconds => stamp(seconds).slice(11).replace(/\.?0+$/, "");
const STAMPS = page.time_s.map(stamp);

function rowAt(seconds) {  // the row nearest to a time
  let low = 0, high = ROWS - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (page.time_s[middle] <= seconds) low = middle; else high = middle;
  }
  return seconds - page.time_s[low] <= page.time_s[high] - seconds ? low : high;
}

// --- lines: copies of columns with nothing in them before each row at which the pen is lifted

function lifted(columns, rows) {
  if (!rows.length) return columns;
  const lifts = [...new Set(rows)].sort((a, b) => a - b);
  return columns.map(column => {
    const line = [];
    let done = 0;
    for (const row of lifts) {
      for (; done < row; done++) line.push(column[done]);
      line.push(null);
    }
    for (; done < column.length; done++) line.push(column[done]);
    return line;
  });
}

function line(x, y, colour, width, more) {
  return {x, y, type: "scatter", mode: "lines", hoverinfo: "skip", line: {color: colour, width}, ...more};
}

const methods = Object.keys(page.predicted);
const visible = method => !state.hidden.has(method);
const methodColour = method => page.style.methods[method];

// --- time series: a panel a quantity over one axis of time

const controls = page.style.controls;  // the actuator, colour and width of each control channel
const axisName = number => "y" + (number ? number + 1 : "");

function seriesTraces() {
  const traces = [];
  panels.forEach(({names}, number) => {
    for (const name of names) {
      const [x, y] = lifted([STAMPS, drawn(name)], [...page.holes, ...(page.lifts[name] || [])]);
      const {colour, width, dash} = controls[name] || {colour: colours.ink, width: 1.2};
      const trace = line(x, y, colour, width, {yaxis: axisName(number), meta: {channel: name}});
      if (dash) trace.line.dash = dash;
      traces.push(trace);
    }
    for (const method of methods) {
      const data = page.predicted[method];
      for (const name of names.filter(name => name in data.channels)) {
        const lifts = [...data.holes, ...(data.lifts[name] || [])];
        const [x, y] = lifted([data.time_s.map(stamp), drawn(name, data)], lifts);
        traces.push(line(x, y, methodColour(method), 1.1, {yaxis: axisName(number), meta: {channel: name, method}}));
      }
    }
  });
  return traces;
}

const pathTime = seconds => stamp(seconds).replace(" ", "_");

function heldShade() {  // one path for all stretches: hundreds of shapes would be slow
  const path = page.held.map(([a, b]) => `M${pathTime(a)},0V1H${pathTime(b)}V0Z`).join("");
  const shape = {type: "path", path, xref: "x", yref: "paper", layer: "below", line: {width: 0},
    fillcolor: colours.held, opacity: 0.2};
  return path ? [shape] : [];
}

const BAND = [1.008, 1.026];  // above the panels, in heights of all of them

function manoeuvreBands() {
  const bands = page.manoeuvres.map(each => ({type: "rect", xref: "x", yref: "paper", x0: stamp(each.start_s),
    x1: stamp(each.end_s), y0: BAND[0], y1: BAND[1], fillcolor: colours.manoeuvre, opacity: 0.6, line: {width: 1, color: "#fff"}}));
  const changes = changesInSight().map(({seconds}) => `M${pathTime(seconds)},0V${BAND[0]}`).join("");
  const lines = {type: "path", path: changes, xref: "x", yref: "paper", layer: "below",
    line: {width: 0.8, color: colours.manoeuvre, dash: "dot"}};
  return changes ? [...bands, lines] : bands;
}

const MANY = 80;  // changes of command; more than these would hide what they mark, so only the first of each is left

function changesInSight() {
  const changes = page.manoeuvres.flatMap((each, number) => [each.start_s, ...each.executes_s].map((seconds, at) =>
    ({seconds, text: at ? "" : String(number + 1)})));
  const near = changes.filter(({seconds}) => seconds >= state.from && seconds <= state.to);
  return near.length > MANY ? near.filter(({text}) => text) : near;
}

const shapes = () => [...heldShade(), ...manoeuvreBands()];

function manoeuvreNumbers() {
  return page.manoeuvres.map((each, number) => ({x: stamp((each.start_s + each.end_s) / 2), y: (BAND[0] + BAND[1]) / 2, yref: "paper",
    yanchor: "middle", text: String(number + 1), showarrow: false, font: {size: 10}}));
}

function keyOf(names, number) {  // which colour is which actuator, above the panel
  const text = names.filter(name => !controls[name].dash).map(name => `<span style="color:${controls[name].colour}">` +
    `<b>${controls[name].actuator}</b></span>`).join("   ");
  return {x: 1, y: domainOf(number)[1], xref: "paper", yref: "paper", xanchor: "right", yanchor: "bottom", text,
    showarrow: false, font: {size: 11}};
}

const GAP = 0.16;  // between panels, in heights of a panel and its gap

function domainOf(number) {
  const top = 1 - number / (panels.length - GAP);
  return [Math.max(top - (1 - GAP) / (panels.length - GAP), 0), top];
}

function seriesLayout() {
  const layout = {...common(), margin: {l: 74, r: 14, t: 60, b: 44}, shapes: shapes(),
    annotations: [...manoeuvreNumbers(),
      ...panels.flatMap(({names}, number) => names.some(name => name in controls) ? [keyOf(names, number)] : [])],
    xaxis: {type: "date", range: [stamp(0), stamp(Math.max(END_S, 1))], anchor: axisName(panels.length - 1),
      title: {text: "time, UTC"}, gridcolor: colours.grid}};
  panels.forEach(({title, names}, number) => {
    layout["yaxis" + (number ? number + 1 : "")] = {domain: domainOf(number), gridcolor: colours.grid,
      zeroline: false, nticks: 5, automargin: false,
      title: {text: title.replace(" [", "<br>["), standoff: 4, font: {size: 11}},
      ...ticksOf(names, reach(names.flatMap(name => drawn(name))))};
  });
  return layout;
}

const STEPS = [1, 2, 5, 10, 30, 45, 90, 180];  // of angles between ticks: whole turns would all be called alike
const MOST_TICKS = 5;

function ticksOf(names, [low, high]) {  // of angles the round ones, as they are called within the turn
  const angle = names.find(name => name in page.angles);
  if (angle === undefined || !(low <= high)) return {tickmode: "auto"};
  const step = STEPS.find(each => (high - low) / each <= MOST_TICKS) || 180, least = page.angles[angle];
  const first = Math.floor(low / step) - 1, count = Math.ceil(high / step) + 2 - first;
  const tickvals = Array.from({length: count}, (_, number) => (first + number) * step);
  return {tickmode: "array", tickvals, ticktext: tickvals.map(each => String((((each - least) % 360) + 360) % 360 + least))};
}

const ticksOfAxis = (axis, ticks) => Object.fromEntries(Object.entries(ticks).map(([key, value]) => [`${axis}.${key}`, value]));

function common() {
  return {showlegend: false, hovermode: false, dragmode: "zoom", uirevision: "kept", plot_bgcolor: "#fff",
    paper_bgcolor: "#fff", font: {family: "system-ui, sans-serif", size: 11, color: colours.ink}};
}

// --- the track: all of it faint, the stretch that is looked at in ink, broad where controls were held

function trackTraces() {
  const east = channel("east_m"), north = channel("north_m");
  const inside = (from, to) => rowsOf(Math.max(from, state.from), Math.min(to, state.to));
  const whole = state.from === 0 && state.to === END_S;
  const traces = [line(...lifted([east, north], page.holes), whole ? colours.ink : colours.faint, 1.2)];
  if (!whole) {
    const path = joined([inside(0, END_S)]);
    traces.push(line(path.x, path.y, colours.ink, 1.2, {meta: {stretch: true}}));
  }
  const held = joined(page.held.map(([a, b]) => inside(a, b)));
  if (held.x.length) traces.unshift(line(held.x, held.y, colours.held, 6, {opacity: 0.5, meta: {held: true}}));
  return [...traces, ...predictedTracks(), executePoints(), ends()];
}

function rowsOf(from, to) {  // the rows between two times [s], both included, as [first, end)
  let first = rowAt(from), last = rowAt(to);
  if (page.time_s[first] < from) first++;
  if (page.time_s[last] > to) last--;
  return [first, last + 1];
}

function joined(ranges) {  // stretches of the track as one line, lifted between them and at holes
  const holes = new Set(page.holes), x = [], y = [];
  for (const [first, end] of ranges.filter(([first, end]) => end > first)) {
    if (x.length) { x.push(null); y.push(null); }
    for (let row = first; row < end; row++) {
      if (row > first && holes.has(row)) { x.push(null); y.push(null); }
      x.push(channel("east_m")[row]); y.push(channel("north_m")[row]);
    }
  }
  return {x, y};
}

function predictedTracks() {
  return methods.filter(method => "north_m" in page.predicted[method].channels).map(method => {
    const data = page.predicted[method], seen = data.time_s.map(s => s >= state.from && s <= state.to);
    const column = name => data.channels[name].map((value, row) => seen[row] ? value : null);
    const [x, y] = lifted([column("east_m"), column("north_m")], data.holes);
    return line(x, y, methodColour(method), 1.2, {visible: visible(method), meta: {method}});
  });
}

function executePoints() {
  const points = changesInSight().map(each => ({...each, row: rowAt(each.seconds)}));
  return {x: points.map(point => channel("east_m")[point.row]), y: points.map(point => channel("north_m")[point.row]),
    text: points.map(point => point.text), type: "scatter", mode: "markers+text", textposition: "top center",
    hoverinfo: "skip", marker: {symbol: "circle", size: points.map(point => point.text ? 8 : 5),
      color: colours.manoeuvre, line: {color: colours.ink, width: 0.8}}, meta: {executes: true}};
}

function ends() {
  const known = page.time_s.map((_, row) => row).filter(row => channel("east_m")[row] != null);
  const rows = known.length ? [known[0], known[known.length - 1]] : [];
  return {x: rows.map(row => channel("east_m")[row]), y: rows.map(row => channel("north_m")[row]),
    text: ["<b>start</b>", "<b>end</b>"], type: "scatter", mode: "markers+text", textposition: "bottom right",
    hoverinfo: "skip", marker: {symbol: ["circle-open", "square"], size: 9, color: colours.ink, line: {width: 2}}};
}

function trackLayout() {
  const axis = {gridcolor: colours.grid, zeroline: false};
  return {...common(), margin: {l: 62, r: 10, t: 12, b: 44},
    xaxis: {...axis, title: {text: labels.east_m}, constrain: "domain"},
    yaxis: {...axis, title: {text: labels.north_m}, scaleanchor: "x", scaleratio: 1},
    annotations: [{x: 0.01, y: 0.99, xref: "paper", yref: "paper", text: "<b>N ↑</b>", showarrow: false}]};
}

const hasTrack = "north_m" in page.channels && "east_m" in page.channels;
const drawTrack = () => hasTrack && Plotly.react(track, trackTraces(), trackLayout(), CONFIG);

// --- how far values reach, and axes that show just the stretch that is looked at

function reach(values) {
  const known = values.filter(value => value != null);
  return [known.reduce((a, b) => Math.min(a, b), Infinity), known.reduce((a, b) => Math.max(a, b), -Infinity)];
}

function withMargin([low, high], least) {
  const margin = 0.06 * (high - low) || least;
  return [low - margin, high + margin];
}

function fitStretch() {
  const [first, end] = rowsOf(state.from, state.to);
  const seen = name => drawn(name).slice(first, end);
  const ranges = panels.map(({names}) => reach(names.flatMap(seen)));
  const known = ranges.map((range, number) => [range, number]).filter(([range]) => range[0] <= range[1]);
  const axis = number => `yaxis${number ? number + 1 : ""}`;
  Plotly.relayout(series, Object.assign({}, ...known.map(([range, number]) =>
    ({[`${axis(number)}.range`]: withMargin(range, 1), ...ticksOfAxis(axis(number), ticksOf(panels[number].names, range))}))));
  const [east, north] = [reach(seen("east_m")), reach(seen("north_m"))];
  if (hasTrack && east[0] <= east[1]) {
    Plotly.relayout(track, {"xaxis.range": withMargin(east, 5), "yaxis.range": withMargin(north, 5)});
  }
}

function showAll() {
  showTimes(0, Math.max(END_S, 1));
  const axis = number => `yaxis${number ? number + 1 : ""}`;
  Plotly.relayout(series, Object.assign({}, ...panels.map(({names}, number) => ({[`${axis(number)}.autorange`]: true,
    ...ticksOfAxis(axis(number), ticksOf(names, reach(names.flatMap(name => drawn(name)))))}))));
  if (hasTrack) Plotly.relayout(track, {"xaxis.autorange": true, "yaxis.autorange": true});
}

// --- the cursor: a line in time, the ship on the track, the values of one row

const axes = plot => [plot._fullLayout.xaxis, plot._fullLayout.yaxis];

function placeLine(mark, row) {
  const axis = axes(series)[0], {t, h} = series._fullLayout._size;
  const at = row === null ? NaN : axis.l2p(milliseconds(page.time_s[row]));
  mark.hidden = !(at >= -1 && at <= axis._length + 1);
  Object.assign(mark.style, {left: `${axis._offset + at}px`, top: `${t}px`, height: `${h}px`});
}

function pixelOf(row) {  // where a row is on the track, in pixels of the plot; null where no position is known
  const [x, y] = axes(track), east = channel("east_m")[row], north = channel("north_m")[row];
  if (east == null || north == null) return null;
  return [x._offset + x.l2p(east), y._offset + y.l2p(north)];
}

function placeShip(row) {
  const at = hasTrack ? pixelOf(row) : null, heading = channel("heading_deg")[row];
  byId("ship").style.display = at ? "" : "none";
  if (!at) return;
  byId("ship").setAttribute("transform", `translate(${at[0]} ${at[1]}) rotate(${heading ?? 0})`);
  byId("hull").style.display = heading == null ? "none" : "";
  byId("dot").style.display = heading == null ? "" : "none";
}

function shown(name, row) {
  const value = channel(name)[row];
  return value == null ? "–" : value.toFixed(page.style.decimals[name]);
}

function speed(row) {
  const surge = channel("surge_mps")[row], sway = channel("sway_mps")[row];
  return surge == null || sway == null ? "–" : Math.hypot(surge, sway).toFixed(2);
}

function read(row) {
  readout.dataset.row = row;
  readout.dataset.time = new Date(milliseconds(page.time_s[row])).toISOString();
  byId("time").textContent = `${STAMPS[row].slice(0, 10)} ${clock(page.time_s[row])} UTC`;
  for (const cell of readout.querySelectorAll("[data-channel]")) cell.textContent = shown(cell.dataset.channel, row);
  byId("speed").textContent = speed(row);
  for (const each of document.querySelectorAll("#manoeuvres tr[data-number]")) {
    const {start_s, end_s} = page.manoeuvres[each.dataset.number];
    each.classList.toggle("at", page.time_s[row] >= start_s && page.time_s[row] <= end_s);
  }
}

function look(row) {  // what is under the mouse; the cursor stays where it is
  placeLine(byId("hovered"), row);
  placeShip(row ?? state.row);
  read(row ?? state.row);
  if (row === null) byId("tip").hidden = true;
}

function moveTo(row) {
  state.row = Math.min(Math.max(row, 0), ROWS - 1);
  placeLine(byId("cursor"), state.row);
  look(null);
}

function step(seconds) {
  const next = rowAt(page.time_s[state.row] + seconds);
  moveTo(next === state.row ? state.row + Math.sign(seconds) : next);
  const at = page.time_s[state.row], width = state.to - state.from;
  if (at < state.from || at > state.to) showTimes(at - width / 2, at + width / 2);
}

// --- what the mouse, the keys and the buttons do

function inside(plot, event) {  // the mouse in pixels of the plot, or null beside its axes
  const frame = plot.getBoundingClientRect(), {l, t, w, h} = plot._fullLayout._size;
  const x = event.clientX - frame.left, y = event.clientY - frame.top;
  return x < l || y < t || x > l + w || y > t + h ? null : [x, y];
}

function rowInSeries(event) {
  const at = inside(series, event), axis = axes(series)[0];
  return at && rowAt((axis.p2l(at[0] - axis._offset) - page.start_ms) / 1000);
}

const REACH_PX = 40;

function rowOnTrack(event) {  // the nearest second of the stretch that is looked at, if one is near
  const at = inside(track, event);
  if (!at) return null;
  const [first, end] = rowsOf(state.from, state.to);
  let nearest = null, least = REACH_PX ** 2;
  for (let row = first; row < end; row++) {
    const pixel = pixelOf(row);
    const apart = pixel ? (pixel[0] - at[0]) ** 2 + (pixel[1] - at[1]) ** 2 : Infinity;
    if (apart < least) { least = apart; nearest = row; }
  }
  return nearest;
}

function tell(row, event) {
  const tip = byId("tip"), frame = track.getBoundingClientRect();
  tip.hidden = row === null;
  if (row === null) return;
  tip.textContent = `${clock(page.time_s[row])} UTC\nspeed ${speed(row)} m/s\nheading ${shown("heading_deg", row)}°\n` +
    `wind ${shown("wind_speed_mps", row)} m/s from ${shown("wind_direction_deg", row)}°`;
  const right = event.clientX - frame.left > 0.6 * frame.width;
  tip.style.left = `${event.clientX - frame.left + (right ? -tip.offsetWidth - 14 : 14)}px`;
  tip.style.top = `${event.clientY - frame.top + 14}px`;
}

// --- manoeuvres: a click on one, in the list, above the panels or on the track, shows it alone

function manoeuvreAbove(event) {  // the manoeuvre whose band above the panels is under the mouse, the shortest of them
  const frame = series.getBoundingClientRect(), {t, h} = series._fullLayout._size, axis = axes(series)[0];
  const up = (t - (event.clientY - frame.top)) / h + 1;
  if (up < BAND[0] - SLACK || up > BAND[1] + SLACK) return null;
  const seconds = (axis.p2l(event.clientX - frame.left - axis._offset) - page.start_ms) / 1000;
  return manoeuvreOf(({start_s, end_s}) => start_s <= seconds && seconds <= end_s);
}

const SLACK = 0.004;  // in heights of all panels
const POINT_PX = 12;

function manoeuvreOnTrack(event) {  // the manoeuvre whose first point is under the mouse
  const at = inside(track, event);
  const near = pixel => pixel && Math.hypot(pixel[0] - at[0], pixel[1] - at[1]) < POINT_PX;
  return at && manoeuvreOf(({start_s}) => near(pixelOf(rowAt(start_s))));
}

function manoeuvreOf(isMeant) {
  const length = number => page.manoeuvres[number].end_s - page.manoeuvres[number].start_s;
  const meant = page.manoeuvres.map((_, number) => number).filter(number => isMeant(page.manoeuvres[number]));
  return meant.length ? meant.reduce((a, b) => length(b) < length(a) ? b : a) : null;
}

function zoomTo(number) {
  const {start_s, end_s} = page.manoeuvres[number], margin = 0.15 * (end_s - start_s) + 5;
  showTimes(start_s - margin, end_s + margin).then(fitStretch);
  moveTo(rowAt(start_s));
}

function followMouse(plot, rowUnder, manoeuvreUnder, told) {
  let pressed = null;
  plot.addEventListener("pointermove", event => {
    const row = rowUnder(event);
    look(row);
    if (told) told(row, event);
    plot.style.cursor = manoeuvreUnder(event) === null ? "" : "pointer";
  });
  plot.addEventListener("pointerleave", () => look(null));
  plot.addEventListener("pointerdown", event => { pressed = event; }, true);
  // plotly covers the page while a button is down, so the release is heard by the window
  window.addEventListener("pointerup", event => {
    const moved = pressed && Math.hypot(event.clientX - pressed.clientX, event.clientY - pressed.clientY);
    const clicked = pressed && pressed.button === 0 && moved < 4 ? pressed : null;
    pressed = null;
    if (clicked === null) return;
    const number = manoeuvreUnder(clicked), row = rowUnder(clicked);
    if (number !== null) zoomTo(number); else if (row !== null) moveTo(row);
  }, true);
}

function showTimes(from, to) {
  return Plotly.relayout(series, {"xaxis.range": [stamp(from), stamp(to)]});
}

function timesChanged() {
  const axis = axes(series)[0];
  const [low, high] = axis.range.map(each => (axis.r2l(each) - page.start_ms) / 1000);
  const from = Math.max(low, 0), to = Math.min(high, END_S);
  byId("shown").textContent = `${clock(Math.round(from))} to ${clock(Math.round(to))} UTC`;
  if (from === state.from && to === state.to) return;  // what follows calls this again
  Object.assign(state, {from, to});
  drawTrack();
  if (page.manoeuvres.length) Plotly.relayout(series, {shapes: shapes()});
}

function toggle(button) {
  const method = button.dataset.method, on = state.hidden.delete(method);
  if (!on) state.hidden.add(method);
  button.setAttribute("aria-pressed", on);
  const mine = series.data.flatMap((trace, number) => trace.meta.method === method ? [number] : []);
  Plotly.restyle(series, {visible: on}, mine);
  drawTrack();
}

const PAPER_PX = [690, 960];  // what of A4 there is within its margins

function resizeAll([width, most]) {
  for (const plot of hasTrack ? [series, track] : [series]) {
    plot.style.maxHeight = most ? `${most}px` : "";
    Plotly.relayout(plot, {width, height: most && plot.clientHeight, autosize: width === null});
  }
}

function listen() {
  followMouse(series, rowInSeries, manoeuvreAbove);
  if (hasTrack) followMouse(track, rowOnTrack, manoeuvreOnTrack, tell);
  series.on("plotly_relayout", timesChanged);
  series.on("plotly_afterplot", () => moveTo(state.row));
  if (hasTrack) track.on("plotly_afterplot", () => placeShip(state.row));
  document.addEventListener("keydown", event => {
    const way = {ArrowLeft: -1, ArrowRight: 1}[event.key];
    if (!way || event.altKey || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    step(way * (event.shiftKey ? 10 : 1));
  });
  document.querySelectorAll("button[data-method]").forEach(each => each.addEventListener("click", () => toggle(each)));
  document.querySelectorAll("#manoeuvres tr").forEach(each =>
    each.addEventListener("click", () => zoomTo(Number(each.dataset.number))));
  byId("whole").addEventListener("click", showAll);
  byId("fit").addEventListener("click", fitStretch);
  window.addEventListener("beforeprint", () => resizeAll(PAPER_PX));
  window.addEventListener("afterprint", () => resizeAll([null, null]));
}

const CONFIG = {responsive: true, displaylogo: false, showTips: false,
  modeBarButtonsToRemove: ["select2d", "lasso2d", "zoomIn2d", "zoomOut2d", "autoScale2d"]};

Plotly.newPlot(series, seriesTraces(), seriesLayout(), CONFIG).then(drawTrack).then(() => {
  listen();
  timesChanged();
  moveTo(0);
  document.body.dataset.ready = "yes";
});
