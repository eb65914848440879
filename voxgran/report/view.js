"use strict";
// Interactive view of packings: unpacks the data of the page (see view.py), places the grains and draws them by plotly.
(() => {
  const find = (name) => document.getElementById("view-" + name);
  const settings = JSON.parse(find("settings").textContent);
  const TYPES = { int16: Int16Array, uint16: Uint16Array, uint32: Uint32Array, float32: Float32Array };
  const AXES = ["x", "y", "z"];
  const SCALE = settings.gradient.map((color, k, all) => [k / (all.length - 1), color]);
  const NONE = new Uint32Array(3);  // plotly triangulates points itself where it is given no triangle
  const state = { packings: [], at: 0, picked: null, under: null, down: null, waiting: false };

  async function unpacked(base64) {
    const binary = atob(base64);
    const bytes = Uint8Array.from(binary, (letter) => letter.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).arrayBuffer();
  }

  function decoded(buffer) {
    const size = new DataView(buffer).getUint32(0, true);
    const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
    for (const [name, { type, shape, at }] of Object.entries(head.arrays)) {
      const length = shape.reduce((a, b) => a * b, 1);
      head[name] = new TYPES[type](buffer, 4 + size + at, length);
    }
    return head;
  }

  // Return a rotation matrix, by rows, of the unit quaternion (w, x, y, z) of a grain.
  function matrix(q, g) {
    const [w, x, y, z] = q.subarray(4 * g, 4 * g + 4);
    return [
      1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
      2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
      2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ];
  }

  // Return first index of each item and the total, of counts.
  function starts(counts) {
    const first = new Uint32Array(counts.length + 1);
    counts.forEach((count, k) => { first[k + 1] = first[k] + count; });
    return first;
  }

  // Place the surfaces of all grains: coordinates and grain of each vertex, corners and first triangle of each grain.
  function place(p) {
    const n = p.grain.length;
    const vertexOf = starts(p.vertex_count), faceOf = starts(p.face_count);
    p.vertexStart = starts(Array.from(p.shape, (s) => p.vertex_count[s]));
    p.faceStart = starts(Array.from(p.shape, (s) => p.face_count[s]));
    p.points = AXES.map(() => new Float32Array(p.vertexStart[n]));
    p.owner = new Uint32Array(p.vertexStart[n]);
    p.corners = new Uint32Array(3 * p.faceStart[n]);
    for (let g = 0; g < n; g++) {
      const s = p.shape[g], r = matrix(p.orientation, g), unit = p.reach[s] * p.scale[g] / 32767;
      for (let k = 0; k < p.vertex_count[s]; k++) {
        const v = 3 * (vertexOf[s] + k), to = p.vertexStart[g] + k;
        const a = p.vertices[v], b = p.vertices[v + 1], c = p.vertices[v + 2];
        for (let axis = 0; axis < 3; axis++) {
          const turned = r[3 * axis] * a + r[3 * axis + 1] * b + r[3 * axis + 2] * c;
          p.points[axis][to] = p.position[3 * g + axis] + unit * turned;
        }
        p.owner[to] = g;
      }
      for (let k = 0; k < 3 * p.face_count[s]; k++) {
        p.corners[3 * p.faceStart[g] + k] = p.vertexStart[g] + p.faces[3 * faceOf[s] + k];
      }
    }
    p.numbers = new Map(Array.from(p.grain, (number, g) => [number, g]));
    p.partners = new Map();
    for (let k = 0; k < p.contacts.length; k += 2) {
      for (const [a, b] of [[p.contacts[k], p.contacts[k + 1]], [p.contacts[k + 1], p.contacts[k]]]) {
        if (!p.partners.has(a)) p.partners.set(a, new Set());
        p.partners.get(a).add(b);
      }
    }
    return p;
  }

  const here = () => state.packings[state.at];
  const shade = () => Math.max(0, here().colors.findIndex((color) => color.name === find("color").value));
  const number = (value) => String(Number(value.toPrecision(4)));
  const withUnit = (value, unit) => number(value) + (unit ? " " + unit : "");
  const values = (p, k) => p.values.subarray(k * p.grain.length, (k + 1) * p.grain.length);

  // Return smallest and largest value over all packings, so that one colour is one value.
  function range(name) {
    let low = Infinity, high = -Infinity;
    for (const p of state.packings) {
      const k = p.colors.findIndex((color) => color.name === name);
      if (k >= 0) for (const v of values(p, k)) { low = Math.min(low, v); high = Math.max(high, v); }
    }
    return [low, high];
  }

  // Return whether values are equal, but for the digits of a number of 32 bits.
  const same = ([low, high]) => !(high - low > 1e-6 * Math.abs(high));

  // Return the values of the darkest and the brightest colour: a single value lies between them.
  function limits(name) {
    const [low, high] = range(name);
    return same([low, high]) ? [low - 0.5 * Math.abs(low) - 0.5, high + 0.5 * Math.abs(high) + 0.5] : [low, high];
  }

  function intensity(p, k) {
    const of = values(p, k);
    return Float32Array.from(p.owner, (g) => of[g]);
  }

  // Return the coordinate of a slider, from the middle, in the unit of the data.
  function plane(p, axis) {
    const [low, high] = p.ends[axis];
    return low + (high - low) * find("cut-" + AXES[axis]).value / 100;
  }

  // Return whether a slider hides nothing.
  const whole = (name) => !find("cut-" + name) || find("cut-" + name).value === find("cut-" + name).defaultValue;

  const visible = (p, g) => AXES.every((name, axis) => {
    const at = p.position[3 * g + axis];
    return whole(name) || (name === "y" ? at >= plane(p, axis) : at <= plane(p, axis));
  });

  // Return the corners of the triangles of the grains that no plane hides, as three arrays.
  function triangles(p, wanted) {
    const kept = [];
    let count = 0;
    for (let g = 0; g < p.grain.length; g++) {
      if (wanted(g)) { kept.push(g); count += p.faceStart[g + 1] - p.faceStart[g]; }
    }
    const found = AXES.map(() => (count ? new Uint32Array(count) : NONE.slice(0, 1)));
    let to = 0;
    for (const g of kept) {
      for (let f = p.faceStart[g]; f < p.faceStart[g + 1]; f++, to++) {
        for (let c = 0; c < 3; c++) found[c][to] = p.corners[3 * f + c];
      }
    }
    return found;
  }

  function ends(p) {
    const margin = 0.03;
    return AXES.map((_, axis) => {
      let low = (p.bounds[0][axis] - p.middle[axis]) / p.length, high = (p.bounds[1][axis] - p.middle[axis]) / p.length;
      if (p.dimension === 2 && axis === 2) [low, high] = [-0.5, 0.5];
      for (const v of p.points[axis]) { if (v < low) low = v; if (v > high) high = v; }
      const wide = (high - low) * margin;
      return [low - wide, high + wide];
    });
  }

  // Surfaces are smooth but for edges on which each side has vertices of its own.
  // In parallel projection plotly takes lights with a negative z for those on the side of the viewer.
  const MATERIAL = {
    type: "mesh3d", flatshading: false, hoverinfo: "none", showscale: false,
    lighting: { ambient: 0.3, diffuse: 0.7, specular: 0.1, roughness: 0.6, fresnel: 0.05,
      vertexnormalsepsilon: 0, facenormalsepsilon: 0 },
    lightposition: { x: 20000, y: -110000, z: -60000 },
  };

  function grains(p) {
    const [i, j, k] = triangles(p, (g) => visible(p, g)), [low, high] = limits(find("color").value);
    const [x, y, z] = p.points;
    return { ...MATERIAL, x, y, z, i, j, k, intensity: intensity(p, shade()), colorscale: SCALE, cmin: low, cmax: high };
  }

  // Return the picked grain, slightly larger, in white, which is no colour of the scale.
  function marked(p) {
    const g = state.picked, shown = g !== null;
    const cut = (all) => (shown ? all.slice(p.vertexStart[g], p.vertexStart[g + 1]) : new Float32Array(1));
    const points = p.points.map(cut);
    if (shown) {
      points.forEach((all, axis) => all.forEach((v, at) => {
        const middle = p.position[3 * g + axis];
        all[at] = middle + 1.02 * (v - middle);
      }));
    }
    if (shown && p.dimension === 2) points[2].fill(0.05);
    const corner = (c) => (shown
      ? Uint32Array.from({ length: p.faceStart[g + 1] - p.faceStart[g] },
        (_, f) => p.corners[3 * (p.faceStart[g] + f) + c] - p.vertexStart[g])
      : NONE.slice(0, 1));
    const [x, y, z] = points;
    return { ...MATERIAL, x, y, z, i: corner(0), j: corner(1), k: corner(2), color: "#ffffff", hoverinfo: "skip" };
  }

  function frame(p) {
    const at = AXES.map(() => []);
    for (let k = 0; k < p.lines.length; k += 6) {
      at.forEach((all, axis) => all.push(p.lines[k + axis], p.lines[k + 3 + axis], null));
    }
    const [x, y, z] = at;
    return { type: "scatter3d", mode: "lines", x, y, z, line: { color: "#7c8790", width: 2 }, hoverinfo: "skip",
      showlegend: false };
  }

  // Return about four round values between two.
  function ticks(low, high) {
    const rough = (high - low) / 4, power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= rough);
    const found = [];
    for (let v = Math.ceil(low / step) * step; v <= high + 1e-9 * step; v += step) found.push(Math.abs(v) < 1e-9 * step ? 0 : v);
    return found;
  }

  function layout(p) {
    const sizes = p.ends.map(([low, high]) => high - low), flat = p.dimension === 2;
    const [right, up, eye] = flat ? [[1, 0, 0], [0, 1, 0], [0, 0, 1]] : settings.axes;
    // plotly shows about two of its units in the height of the canvas; the packing and its labels fill most of that
    const seen = (axis) => axis.reduce((sum, part, k) => sum + Math.abs(part) * sizes[k], 0);
    const across = find("canvas").clientWidth / find("canvas").clientHeight;
    const unit = 1.65 * Math.min(1 / seen(up), across / seen(right));
    const ink = getComputedStyle(document.body).color;
    const scene = { dragmode: flat ? "pan" : "turntable", aspectmode: "manual", uirevision: String(state.at), aspectratio: {} };
    AXES.forEach((name, axis) => {
      const shown = ticks(...p.bounds.map((corner) => corner[axis]));
      scene.aspectratio[name] = unit * sizes[axis];
      scene[name + "axis"] = {
        visible: !(flat && axis === 2), range: p.ends[axis], showbackground: false, showgrid: false, zeroline: false,
        showspikes: false, color: ink, title: { text: name + (p.unit ? " (" + p.unit + ")" : "") },
        tickvals: shown.map((v) => (v - p.middle[axis]) / p.length), ticktext: shown.map(number),
      };
    });
    scene.camera = {
      projection: { type: "orthographic" }, up: flat ? { x: 0, y: 1, z: 0 } : { x: 0, y: 0, z: 1 },
      center: { x: 0, y: 0, z: 0 }, eye: { x: 2 * eye[0], y: 2 * eye[1], z: 2 * eye[2] },
    };
    return { scene, modebar: { bgcolor: "rgba(0,0,0,0)", color: ink }, margin: { l: 0, r: 0, t: 0, b: 0 }, paper_bgcolor: "rgba(0,0,0,0)", showlegend: false,
      font: { color: ink } };
  }

  function say() {
    const p = here(), color = p.colors[shade()], ends = range(color.name), known = ends[0] <= ends[1];
    find("legend").textContent = "Colour: " + color.label;
    find("low").parentElement.classList.toggle("single", same(ends));
    find("low").textContent = known ? withUnit(ends[0], color.unit) : "";
    find("high").textContent = same(ends) ? "" : withUnit(ends[1], color.unit);
    AXES.forEach((name, axis) => {
      if (find("at-" + name)) {
        find("at-" + name).textContent = whole(name) ? "all" : withUnit(p.middle[axis] + plane(p, axis) * p.length, p.unit);
      }
    });
    find("note").textContent = document.querySelectorAll(".view-data")[state.at].dataset.note;
    describe();
  }

  // Write number, shape, values and contacts of the picked grain; a contact is a button that picks that grain.
  function describe() {
    const p = here(), g = state.picked, box = find("info");
    box.replaceChildren();
    if (g === null) return;
    const partners = [...(p.partners.get(p.grain[g]) || [])].sort((a, b) => a - b);
    const said = p.colors.filter((color) => !["shape", "distance"].includes(color.name)).map((color) =>
      color.label + " " + withUnit(values(p, p.colors.indexOf(color))[g], color.unit));
    const name = document.createElement("strong");
    name.textContent = "Grain " + p.grain[g];
    box.append(name, ": shape " + p.shapes[p.shape[g]] + ", " + said.join(", ") + ". ");
    box.append(partners.length ? "In contact with " : "No contact with other grains.");
    partners.forEach((other) => {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = other;
      button.disabled = !p.numbers.has(other);
      button.addEventListener("click", () => pick(p.numbers.get(other)));
      box.append(button, " ");
    });
  }

  async function pick(g) {
    state.picked = g;
    find("grain").value = g === null ? "" : here().grain[g];
    describe();
    const { x, y, z, i, j, k } = marked(here());
    await Plotly.restyle(find("canvas"), { x: [x], y: [y], z: [z], i: [i], j: [j], k: [k] }, [1]);
  }

  // Redraw the grains once for many movements of a slider.
  function cut() {
    say();
    if (state.waiting) return;
    state.waiting = true;
    requestAnimationFrame(async () => {
      state.waiting = false;
      const [i, j, k] = triangles(here(), (g) => visible(here(), g));
      await Plotly.restyle(find("canvas"), { i: [i], j: [j], k: [k] }, [0]);
    });
  }

  async function recolor() {
    say();
    const [low, high] = limits(find("color").value);
    await Plotly.restyle(find("canvas"), { intensity: [intensity(here(), shade())], cmin: low, cmax: high }, [0]);
  }

  async function show(at) {
    state.at = at;
    state.picked = null;
    const p = here(), before = find("color").value || settings.color;
    find("color").replaceChildren(...p.colors.map((color) => new Option(color.label, color.name)));
    find("color").value = p.colors.some((color) => color.name === before) ? before : p.colors[0].name;
    find("controls").querySelectorAll("input[type=range]").forEach((slider) => { slider.value = slider.defaultValue; });
    find("grain").value = "";
    say();
    const config = { displaylogo: false, responsive: true, scrollZoom: true, plotlyServerURL: "",
      modeBarButtonsToRemove: ["resetCameraLastSave3d", "hoverClosest3d"] };
    await Plotly.react(find("canvas"), [grains(p), marked(p), frame(p)], layout(p), config);
  }

  function listen() {
    find("packing").addEventListener("change", (event) => show(event.target.selectedIndex));
    find("color").addEventListener("change", recolor);
    AXES.forEach((name) => { if (find("cut-" + name)) find("cut-" + name).addEventListener("input", cut); });
    find("grain").addEventListener("change", (event) => {
      const g = here().numbers.get(Number(event.target.value));
      pick(event.target.value === "" || g === undefined ? null : g);
    });
    find("reset").addEventListener("click", async () => {
      await show(state.at);
      await Plotly.relayout(find("canvas"), { "scene.camera": layout(here()).scene.camera });
    });
    find("controls").addEventListener("submit", (event) => event.preventDefault());
    // a grain is picked by a click, not by the drag that turns the packing: plotly calls both a click
    const canvas = find("canvas"), under = ({ points: [point] }) => {
      state.under = point.curveNumber === 0 ? here().owner[point.pointNumber] : null;
    };
    canvas.on("plotly_hover", under);
    canvas.on("plotly_click", under);
    canvas.on("plotly_unhover", () => { state.under = null; });
    canvas.addEventListener("pointerdown", (event) => { state.down = [event.clientX, event.clientY]; }, true);
    addEventListener("pointerup", (event) => {
      const still = state.down && Math.hypot(event.clientX - state.down[0], event.clientY - state.down[1]) < 4;
      state.down = null;
      // the frame in which plotly finds what lies under the pointer may come after this
      if (still) setTimeout(() => { if (state.under !== null) pick(state.under); }, 100);
    }, true);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => show(state.at));
  }

  async function start() {
    find("state").textContent = "The view is being loaded.";
    const library = document.createElement("script");
    library.textContent = new TextDecoder().decode(await unpacked(find("viewer").textContent));
    document.head.append(library);
    for (const script of document.querySelectorAll(".view-data")) {
      const p = place(decoded(await unpacked(script.textContent)));
      p.ends = ends(p);
      state.packings.push(p);
    }
    find("body").hidden = false;
    await show(0);
    listen();
    find("state").hidden = true;
    find("body").dataset.ready = "yes";
  }

  addEventListener("load", () => start().catch((error) => {
    find("body").hidden = true;
    find("state").textContent = "This browser cannot show the view (" + error.message + "); the pictures above stand.";
  }));
})();
