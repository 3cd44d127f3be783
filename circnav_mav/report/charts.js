"use strict";
// Charts of a flight, shared by the report and the live page. Each chart is an SVG of columns of samples:
// columns[name] = [times, values], null for an unknown value. Colors are classes in charts.css.
const Charts = (() => {
  const LEFT = 54, RIGHT = 12, TOP = 8, BOTTOM = 20, BAND = 56, FAR = 1e4, DEGREES = 180 / Math.PI;

  // A line: name, column, color, and drawing options. Lines without samples are left out.
  function definitions(f) {
    const turn = { scale: DEGREES }, error = { error: true }, near = f.tolerance, radii = f.radii ?? [f.radius];
    const steadies = f.steadies ?? radii.map(radius => f.steady * f.radius / radius);
    const circles = (name, value) => radii.map((radius, i) => [i ? "" : name, value(radius), "desired"]);
    return [
      { title: "range", unit: "m", band: radii.length === 1 && [f.radius - near, f.radius + near], levels: circles("desired", radius => radius),
        lines: [["measured", "measured", "measured", { dots: true }], ["estimated", "r", "estimate"], ["true", "true_r", "true"]] },
      { title: "error, range - radius", unit: `m, band ±${round(near)} m`, band: [-near, near], shown: [-3 * near, 3 * near],
        lines: [["estimated", "r", "estimate", error], ["true", "true_r", "true", error]] },
      { title: "range rate", unit: "m/s", lines: [["differenced over 1 s", "differenced", "measured"],
        ["true", "true_r_dot", "true"], ["estimated", "r_dot", "estimate"]] },
      { title: "turn rate, left positive", unit: "deg/s", levels: [["limit", f.limit * DEGREES, "limit"],
        ["", -f.limit * DEGREES, "limit"], ...steadies.map((turn, i) => [i ? "" : "steady circle", turn * DEGREES, "desired"])],
        lines: [["true", "true_turn", "true", turn], [f.commanded ?? "commanded", "turn_rate", "estimate", turn],
          ["steady command", "steady_command", "estimate dashed", turn]] },
      { title: "drift: wind minus target motion", unit: "m/s, towards", height: 130,
        lines: [["east", "drift_x", "estimate"], ["north", "drift_y", "north"]] },
      { title: "innovation", unit: "standard deviations", height: 130, shown: [0, 1.6 * f.gate],
        levels: [["gate", f.gate, "rejected"]], lines: [["of each new range", "innovation", "estimate", { dots: true }]] },
      { title: "ranges", unit: "1/s", height: 120, from: 0,
        lines: [["accepted", "accepted", "measured", { bars: true }], ["rejected", "rejected", "rejected", { bars: true }]] },
    ];
  }

  function resolve(flight, columns) {
    const known = line => columns[line[1]]?.[1].some(value => value != null), wanted = columns.desired;
    const desired = time => wanted?.[1][find(wanted[0], time)] ?? flight.radius;
    return definitions(flight).map(chart => ({ ...chart, lines: chart.lines.filter(known).map(([name, column, colour, how = {}]) => {
      const [times, values] = columns[column], { scale = 1, error } = how;
      return { name, colour, times, values: values.map((v, i) => v == null ? null : v * scale - (error ? desired(times[i]) : 0)), ...how };
    }) })).filter(chart => chart.lines.length);
  }

  // --- marks: [from, to, kind, text], to = from for a single moment ---
  const AWAY = { yielded: "takeover", coasting: "outage", "would coast": "outage", "waiting for ranging": "outage", "waiting for the link": "outage" };
  const SAID = { takeover: /taken over|operator has the vehicle/i, outage: /^(range (lost|stale)|(link|vehicle) silent)/i };
  const LETTERS = { takeover: "T", outage: "O", law: "L", alarm: "!" };
  const KINDS = { takeover: "operator has the vehicle", outage: "no ranges or no link", law: "change of law", alarm: "alarm" };

  function marks(bands, alarms) {
    const found = [], phases = bands.phase ?? [], laws = (bands.law ?? []).filter(span => span[2]);
    const first = phases.findIndex(([, , word]) => !(AWAY[word] === "outage" || word === "ready"));
    phases.forEach(([from, to, word], i) => { if (AWAY[word] && first >= 0 && i > first) found.push([from, to, AWAY[word], word]); });
    laws.slice(1).forEach(([from, , word], i) => { if (laws[i][2] !== word) found.push([from, from, "law", `law ${word}`]); });
    for (const [time, words] of alarms) {
      const kind = Object.keys(SAID).find(kind => SAID[kind].test(words)) ?? "alarm"; // a takeover at the end and a short outage have no phase
      if (kind === "alarm" || !found.some(([from, to, has]) => has === kind && time > from - 2 && time < to + 1)) found.push([time, time, kind, words]);
    }
    return found.sort((a, b) => a[0] - b[0]);
  }

  // --- numbers ---
  const round = value => Number(value.toPrecision(4));
  const px = value => Math.min(Math.max(value, -FAR), FAR).toFixed(1);
  const escaped = text => String(text).replace(/[&<>"]/g, sign => `&#${sign.charCodeAt(0)};`);
  const nice = length => { const power = 10 ** Math.floor(Math.log10(length)); return [5, 2, 1].map(n => n * power).find(n => n <= length * 1.000001); };

  function steps(low, high, about) {
    const step = nice((high - low) / about), found = [];
    for (let n = Math.ceil(low / step); n * step <= high + step * 1e-9; n++) found.push(Number((n * step).toPrecision(10)));
    return found;
  }

  // Index of the last sample at or before a time, -1 before the first.
  function find(times, time) {
    let low = 0, high = times.length;
    while (low < high) { const middle = (low + high) >> 1; if (times[middle] <= time) low = middle + 1; else high = middle; }
    return low - 1;
  }

  function limits(chart, [from, to]) {
    let low = chart.from ?? Infinity, high = -Infinity;
    const reach = value => { if (value != null) { low = Math.min(low, value); high = Math.max(high, value); } };
    for (const { times, values } of chart.lines)
      for (let i = Math.max(find(times, from), 0); i < times.length && times[i] <= to; i++) reach(values[i]);
    // Far from the circle, fixed limits would leave the chart empty: follow the values until some are inside.
    if (chart.shown && low < chart.shown[1] && high > chart.shown[0]) return chart.shown;
    for (const [, value] of chart.levels ?? []) reach(value);
    if (low > high) return [0, 1];
    const room = (high - low || Math.abs(high) || 1) * .06;
    return [chart.from ?? low - room, high + room];
  }

  // --- strips ---
  function strip(chart, view, width, marked = []) {
    const height = chart.height ?? 190, wide = width - LEFT - RIGHT, tall = height - TOP - BOTTOM, [low, high] = limits(chart, view);
    const x = time => wide * (time - view[0]) / (view[1] - view[0]), y = value => tall * (high - value) / (high - low);
    const inside = marked.filter(([from, to]) => to >= view[0] && from <= view[1]).map(([from, to, kind, words]) =>
      `<g class="mark ${kind}"><title>${escaped(words)}, ${round(from)} s</title>` + (to > from
        ? `<rect x="${px(x(from))}" width="${px(Math.max(x(to) - x(from), 1))}" height="${tall}"/>`
        : `<path d="M${px(x(from))},0v${tall}"/>`) + "</g>");
    if (chart.band) {
      const top = Math.max(y(chart.band[1]), 0), bottom = Math.min(y(chart.band[0]), tall);
      if (bottom > top) inside.unshift(`<rect y="${px(top)}" width="${wide}" height="${px(bottom - top)}" class="band"/>`);
    }
    for (const [, value, colour] of chart.levels ?? []) inside.push(`<path d="M0,${px(y(value))}h${wide}" class="level ${colour}"/>`);
    for (const line of chart.lines) inside.push(draw(line, view, x, y, tall));
    const labels = steps(low, high, tall / 40).map(v => `<path d="M${LEFT},${px(TOP + y(v))}h${wide}" class="grid"/>`
      + `<text x="${LEFT - 6}" y="${px(TOP + y(v) + 4)}" text-anchor="end">${v}</text>`);
    return `<rect x="${LEFT}" y="${TOP}" width="${wide}" height="${tall}" class="plot"/>${labels.join("")}${timeAxis(view, width, height)}`
      + `<svg x="${LEFT}" y="${TOP}" width="${wide}" height="${tall}">${inside.join("")}</svg>`;
  }

  function draw({ times, values, colour, dots, bars }, [from, to], x, y, tall) {
    let path = "", beyond = "", pen = "M";
    for (let i = Math.max(find(times, from), 0); i < times.length; i++) {
      const v = values[i], at = px(x(times[i]));
      if (v == null) pen = "M";
      else if (bars) path += v ? `M${at},${tall}V${px(y(v))}H${px(x(times[i + 1]))}V${tall}Z` : "";
      else if (!dots) { path += `${pen}${at},${px(y(v))}`; pen = "L"; }
      else if (y(v) < 0 || y(v) > tall) beyond += y(v) < 0 ? `M${at},0l-3,5h6Z` : `M${at},${tall}l-3,-5h6Z`; // points out of the frame
      else path += `M${at},${px(y(v))}h0`;
      if (times[i] > to) break; // one beyond either end, so that the line leaves the frame
    }
    const fill = beyond && `<path d="${beyond}" class="filled beyond ${colour}"/>`;
    return `<path d="${path}" class="${bars ? "filled" : dots ? "dots" : "line"} ${colour}"/>${fill}`;
  }

  function timeAxis(view, width, height) {
    const wide = width - LEFT - RIGHT;
    return steps(view[0], view[1], Math.max(2, wide / 90)).map(t => {
      const half = 3.5 * String(t).length, x = Math.min(LEFT + wide * (t - view[0]) / (view[1] - view[0]), width - half);
      return `<text x="${px(x)}" y="${height - 5}" text-anchor="middle">${t}</text>`;
    }).join("");
  }

  // Texts over time: each stretch has the color of its text, and the text as a label if there is room.
  function band(spans, view, width) {
    const wide = width - LEFT - RIGHT, x = time => wide * (time - view[0]) / (view[1] - view[0]);
    const words = spans.map(span => span[2]);
    const inside = spans.filter(([from, to, word]) => word && to >= view[0] && from <= view[1]).map(([from, to, word]) => {
      const begin = Math.max(x(from), 0), room = Math.min(x(to), wide) - begin, of = colour(word, words);
      const name = room > 7 * word.length + 8 ? `<text x="${px(begin + 5)}" y="18">${escaped(word)}</text>` : "";
      return `<g class="stretch ${of}"><rect x="${px(begin)}" width="${px(Math.max(room, .6))}" height="26"/>${name}`
        + `<title>${escaped(word)}, ${round(from)} to ${round(to)} s</title></g>`;
    });
    return `${timeAxis(view, width, BAND)}<svg x="${LEFT}" y="${TOP}" width="${wide}" height="26">${inside.join("")}</svg>`;
  }

  const KNOWN = new Map(Object.entries({
    waits: ["waiting for the link", "waiting for ranging", "unknown"], ready: ["ready", "trial", "LOITER", "AUTO.LOITER", "HOLD"],
    good: ["engaged", "would steer", "drift", "GUIDED", "OFFBOARD"], other0: ["feedforward", "leaving", "RTL", "AUTO.RTL", "LAND", "AUTO.LAND"],
    held: ["coasting", "would coast"], away: ["yielded"], over: ["ended"],
  }).flatMap(([colour, words]) => words.map(word => [word, colour])));

  // Known words have the same color on every page. Other words get colors in order of appearance.
  const colour = (word, words = []) => KNOWN.get(word) ?? `other${[...new Set(words)].filter(one => one && !KNOWN.has(one)).indexOf(word) % 4}`;

  // --- the track: ways = [{ name, colour, times, east, north }], relative to the target, north up ---
  // others = [[name, [east, north]]]: present positions of other vehicles.
  function track(ways, radii, side, { view = [-Infinity, Infinity], marked = [], at = null, heading = null, drift = null, others = [] } = {}) {
    const here = ways.map(way => ({ ...way, known: way.times.flatMap((t, i) => way.east[i] != null && t >= view[0] && t <= view[1] ? [i] : []) }))
      .filter(way => way.known.length);
    if (!here.length) return null;
    const reach = 1.08 * here.reduce((most, way) => way.known.reduce((m, i) => Math.max(m, Math.abs(way.east[i]), Math.abs(way.north[i])), most), Math.max(...radii));
    const half = side / 2, scale = half / reach, length = nice(reach / 2), [main] = here;
    const place = (way, i) => [half + scale * way.east[i], half - scale * way.north[i]], point = (way, i) => place(way, i).map(px).join(",");
    const whole = main.known[0] === 0 ? "" : " hollow"; // filled at the start of the flight, hollow at the first estimate
    const parts = [`<rect width="${side}" height="${side}" class="plot"/>`,
      `<path d="M12,${side - 14}h${px(length * scale)}" class="axis"/><text x="12" y="${side - 20}">${length} m</text>`,
      `<path d="M${side - 18},34v-22l-5,9m5,-9l5,9" class="axis"/><text x="${side - 22}" y="48">N</text>`,
      drift ? driftArrow(drift, side) : "",
      ...here.map(way => `<path d="${way.known.map((i, n) => (way.known[n - 1] === i - 1 ? "L" : "M") + point(way, i)).join("")}" class="line ${way.colour}"/>`),
      ...radii.map(radius => `<circle cx="${half}" cy="${half}" r="${px(scale * radius)}" class="level desired"/>`), // on the track, not under it
      ...[.08, .25, .45, .65, .85, .99].map(share => arrow(main, Math.floor(share * (main.known.length - 1)), place)),
      `<path d="M${half - 8},${half}h16M${half},${half - 8}v16" class="target"/>`,
      `<path d="M${point(main, main.known[0])}m0,-8l7,13h-14z" class="start${whole}"/>`];
    for (const [from, , kind, words] of marked) {
      const i = find(main.times, from);
      if (i < 0 || main.east[i] == null || from < view[0] || from > view[1]) continue;
      const [x, y] = place(main, i);
      parts.push(`<g class="place ${kind}"><title>${escaped(words)}, ${round(from)} s</title><circle cx="${px(x)}" cy="${px(y)}" r="7.5"/>`
        + `<text x="${px(x)}" y="${px(y + 4)}" text-anchor="middle">${LETTERS[kind]}</text></g>`);
    }
    for (const [name, [east, north]] of others) {
      const [x, y] = [half + scale * east, half - scale * north];
      parts.push(`<circle cx="${px(x)}" cy="${px(y)}" r="6" class="now desired"/><text x="${px(x + 9)}" y="${px(y + 4)}">${escaped(name)}</text>`);
    }
    for (const way of at == null ? [] : [...here].reverse()) { // the first one, with its heading, on top
      const i = find(way.times, at);
      if (i < 0 || way.east[i] == null) continue;
      const [x, y] = place(way, i);
      parts.push(heading == null || way !== main ? `<circle cx="${px(x)}" cy="${px(y)}" r="6" class="now ${way.colour}"/>`
        : `<path d="M0,-11L7,8L0,4L-7,8Z" transform="translate(${px(x)},${px(y)}) rotate(${px(heading * DEGREES)})" class="now ${way.colour}"/>`);
    }
    return parts.join("");
  }

  // Drift of the vehicle past the target, [east, north] in m/s: an arrow in the corner, because the drift belongs to no place.
  function driftArrow([east, north], side) {
    const speed = Math.hypot(east, north), turn = Math.atan2(east, north) * DEGREES;
    const sign = speed < .05 ? "" : `<path d="M0,14V-14l-5,9m5,-9l5,9" transform="rotate(${px(turn)})" class="axis drift"/>`;
    return `<g transform="translate(${side - 112},${side - 26})"><title>estimated drift: wind minus target motion</title>${sign}`
      + `<text x="20" y="4">drift ${speed.toFixed(1)} m/s</text></g>`;
  }

  function arrow(way, n, place) {
    const i = way.known[n], next = way.known.slice(n + 1, n + 40).find(j => way.east[j] !== way.east[i] || way.north[j] !== way.north[i]);
    if (next === undefined) return "";
    const [x, y] = place(way, i), [ahead, up] = place(way, next);
    return `<path d="M-6,-6L8,0L-6,6Z" transform="translate(${px(x)},${px(y)}) rotate(${px(Math.atan2(up - y, ahead - x) * DEGREES)})" class="filled ${way.colour}"/>`;
  }

  // --- on a page ---
  const key = (name, colour, n = null) => `<span class="key"><i class="${colour}"></i>${escaped(name)}${n === null ? "" : `<b data-line="${n}"></b>`}</span>`;

  // Drag over a chart to zoom, double-click for the whole flight. The pointer shows values. All charts share the time axis.
  function mount(room, map, tools) {
    let model = null, charts = [], view = null, pointer = null, pressed = null;
    tools.innerHTML = '<button data-do="in">+</button><button data-do="out">&minus;</button><button data-do="back">&#9664;</button>'
      + '<button data-do="on">&#9654;</button><button data-do="all">whole flight</button><output></output><span class="legend"></span>';
    const shown = () => view ?? model.span, wide = () => Math.max(room.clientWidth, 280), clock = tools.querySelector("output");

    function redraw() {
      const width = wide(), marked = marks(model.bands, model.alarms), kinds = [...new Set(marked.map(mark => mark[2]))];
      tools.querySelector(".legend").innerHTML = kinds.map(kind => `<span class="key place ${kind}"><i>${LETTERS[kind]}</i>${KINDS[kind]}</span>`).join("");
      const strips = resolve(model.flight, model.columns).map(chart => ({ ...chart, height: chart.height ?? 190,
        inside: strip(chart, shown(), width, marked), keys: [...chart.lines.map((line, n) => key(line.name, line.colour, n)),
          ...(chart.levels ?? []).filter(([name]) => name).map(([name, , colour]) => key(name, colour))],
        value: (n, time) => { const { times, values } = chart.lines[n], i = find(times, time); return i < 0 || values[i] == null ? "-" : round(values[i]); } }));
      const [phase = [], ...others] = Object.entries(model.bands).filter(([, spans]) => spans.length).map(([title, spans]) => {
        const words = [...new Set(spans.map(span => span[2]))].filter(Boolean);
        return { title, unit: "", height: BAND, inside: band(spans, shown(), width), value: (n, time) =>
          spans.find(([from, to, word]) => word === words[n] && time >= from && time <= to) ? "\u25c0" : "",
          keys: words.map((word, n) => key(word, colour(word, words), n)) };
      });
      charts = [phase, ...strips, ...others].flat();
      while (room.children.length > charts.length) room.lastChild.remove();
      while (room.children.length < charts.length) room.append(document.createElement("figure"));
      charts.forEach(({ title, unit, height, inside, keys }, i) => {
        room.children[i].innerHTML = `<figcaption><b>${escaped(title)}</b> <span class="unit">${escaped(unit)}</span>${keys.join("")}</figcaption>`
          + `<svg viewBox="0 0 ${width} ${height}" class="strip" role="img" aria-label="${escaped(title)}">${inside}<path class="cursor" d="M0,${TOP}V${height - BOTTOM}"/></svg>`;
      });
      tools.querySelector('[data-do="all"]').disabled = view === null;
      point();
    }

    // Parts that change only with the pointer: line in each chart, values in its legend, position on the track.
    function point() {
      const [from, to] = shown(), time = pointer, x = LEFT + (wide() - LEFT - RIGHT) * (time - from) / (to - from);
      [...room.children].forEach((figure, i) => {
        const cursor = figure.querySelector(".cursor");
        cursor.style.visibility = time === null ? "hidden" : "visible";
        if (time !== null) cursor.setAttribute("transform", `translate(${px(x)},0)`);
        for (const node of figure.querySelectorAll("[data-line]")) node.textContent = time === null ? "" : ` ${charts[i].value(node.dataset.line, time)}`;
      });
      clock.textContent = time === null ? "" : `${time.toFixed(2)} s`;
      const at = time ?? model.now ?? null, heading = newest("heading", at);
      const drift = [newest("drift_x", at ?? Infinity), newest("drift_y", at ?? Infinity)];
      const side = Math.max(Math.min(map.clientWidth, 520), 240), marked = marks(model.bands, model.alarms);
      const drawn = track(model.ways, model.flight.radii ?? [model.flight.radius], side, { view: view ?? undefined, marked, at, heading,
        drift: drift.includes(null) ? null : drift, others: time === null ? model.others : [] });
      const other = model.others?.length ? [key("other vehicles", "desired")] : [];
      const keys = drawn && [...model.ways.map(way => key(way.name, way.colour)), key("desired", "desired"), ...other].join("");
      map.innerHTML = drawn ? `<figcaption><b>track</b> <span class="unit">relative to the target</span>${keys}</figcaption>`
        + `<svg viewBox="0 0 ${side} ${side}" class="track" role="img" aria-label="track">${drawn}</svg>`
        : '<p class="none">No track: ranges alone do not determine the path.</p>';
    }

    // Value of a column's last sample at or before a time, null if unknown.
    function newest(name, time) {
      const [times, values] = model.columns[name] ?? [[], []], i = time === null ? -1 : find(times, time);
      return i < 0 ? null : values[i];
    }

    function zoom(from, to) {
      const [first, last] = model.span, length = Math.max(to - from, (last - first) / 2000, .2);
      const begin = Math.min(Math.max(from, first), last - length);
      view = length >= last - first ? null : [begin, begin + length];
      redraw();
    }

    const timeAt = event => {
      const svg = event.target.closest?.("svg.strip");
      if (!svg || !model) return null;
      const box = svg.getBoundingClientRect(), share = ((event.clientX - box.left) / box.width * wide() - LEFT) / (wide() - LEFT - RIGHT);
      return share >= 0 && share <= 1 ? shown()[0] + share * (shown()[1] - shown()[0]) : null;
    };
    room.addEventListener("pointermove", event => { if (!model) return; pointer = timeAt(event); point(); });
    room.addEventListener("pointerleave", () => { if (!model) return; pointer = null; point(); });
    room.addEventListener("pointerdown", event => { pressed = timeAt(event); });
    room.addEventListener("pointerup", event => {
      const until = timeAt(event), [from, to] = model ? shown() : [0, 1];
      if (pressed !== null && until !== null && Math.abs(until - pressed) > .02 * (to - from)) zoom(Math.min(pressed, until), Math.max(pressed, until));
      pressed = null;
    });
    room.addEventListener("dblclick", () => { view = null; redraw(); });
    tools.addEventListener("click", event => {
      const what = event.target.dataset.do;
      if (!what || !model) return;
      const [from, to] = shown(), length = to - from, middle = (from + to) / 2, move = { back: -.5, on: .5 }[what] * length;
      if (what === "all") { view = null; redraw(); }
      else if (what === "in" || what === "out") { const half = length * (what === "in" ? .25 : 1); zoom(middle - half, middle + half); }
      else zoom(from + move, to + move);
    });
    addEventListener("resize", () => model && redraw());
    return { update(next) { model = next; redraw(); } };
  }

  return { resolve, marks, steps, find, colour, strip, band, track, mount };
})();
