// Draws sketches of a fold: convex modules, the farthest first, each face in the light that falls on it.
const SHADOW_SCALE = 1 / 6;
const SHADOW = 0.2;
const NEAREST = 0.05;
const EDGE = "rgb(20 22 26 / .38)";
const EDGED_PX = 5;

let paper = null;
let pen = null;
let size = null;
let outline = null;
let latest = null;
let due = false;

onmessage = ({ data }) => {
  if (data.is === "begin") {
    ({ paper, size } = data);
    pen = paper.getContext("2d", { willReadFrequently: true }); // by the processor: quicker where graphics are software
  } else if (data.is === "size") {
    ({ size } = data);
    ask(false);
  } else if (data.is === "outline") {
    ({ outline } = data);
    latest = null;
  } else if (data.is === "frame") {
    latest = data.data;
    ask(true);
  }
};

let owed = false;
function ask(told) {
  owed ||= told;
  if (due) return;
  due = true;
  (self.requestAnimationFrame ?? ((draw) => setTimeout(draw, 16)))(() => {
    due = false;
    if (outline && latest && size.width) draw(outline, latest);
    if (owed) { owed = false; postMessage("drawn"); }
  });
}

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => { const l = Math.hypot(...a) || 1; return [a[0] / l, a[1] / l, a[2] / l]; };
const SIDE = unit([-0.3, -1.0, 0.5]);

// How bright a face with this outward normal is: sky, a light from the side, a little from below.
function light(x, y, z) {
  const side = Math.max(0, x * SIDE[0] + y * SIDE[1] + z * SIDE[2]);
  return Math.min(1.2, 0.5 + 0.26 * (z * 0.5 + 0.5) + 0.36 * Math.max(0, z) + 0.3 * side);
}

function draw({ modules, corners, faces, normals, field_of_view_rad: angle }, data) {
  const numbers = new Float32Array(data, 0, 7 + 7 * modules);
  const colours = new Uint8Array(data, 4 * numbers.length, 3 * modules);
  const width = Math.round(size.width * size.scale);
  const height = Math.round(size.height * size.scale);
  if (paper.width !== width || paper.height !== height) { paper.width = width; paper.height = height; }
  pen.clearRect(0, 0, width, height);
  pen.lineJoin = "round";
  pen.lineWidth = size.scale;

  const eye = numbers.subarray(0, 3);
  const out = unit([eye[0] - numbers[3], eye[1] - numbers[4], eye[2] - numbers[5]]);
  const right = unit(cross([0, 0, 1], out));
  const up = cross(out, right);
  const zoom = height / 2 / Math.tan(angle / 2);
  const see = (x, y, z, at) => {
    const d = [x - eye[0], y - eye[1], z - eye[2]];
    const depth = Math.max(NEAREST, -dot(d, out));
    at[0] = width / 2 + (zoom * dot(d, right)) / depth;
    at[1] = height / 2 - (zoom * dot(d, up)) / depth;
  };

  shadow(modules, numbers, see, width, height);

  const far = new Float32Array(modules);
  const order = new Uint32Array(modules);
  for (let i = 0; i < modules; i++) {
    const k = 7 + 7 * i;
    far[i] = Math.hypot(numbers[k] - eye[0], numbers[k + 1] - eye[1], numbers[k + 2] - eye[2]);
    order[i] = i;
  }
  order.sort((a, b) => far[b] - far[a]);

  const reach = normals.map((normal, f) => dot(normal, corners[faces[f][0]]));
  const points = corners.map(() => [0, 0]);
  const r = new Float64Array(9);
  for (const i of order) {
    const k = 7 + 7 * i;
    const [x, y, z] = [numbers[k], numbers[k + 1], numbers[k + 2]];
    turn(numbers[k + 3], numbers[k + 4], numbers[k + 5], numbers[k + 6], r);
    // The eye as the module sees it tells which faces look at us.
    const e = [eye[0] - x, eye[1] - y, eye[2] - z];
    // Modules that are large enough show their edges; on small ones the line closes hairlines.
    const edged = zoom / Math.max(NEAREST, dot(e, out)) > EDGED_PX * size.scale;
    const local = [0, 1, 2].map((c) => r[c] * e[0] + r[3 + c] * e[1] + r[6 + c] * e[2]);
    corners.forEach(([a, b, c], v) => {
      see(x + r[0] * a + r[1] * b + r[2] * c, y + r[3] * a + r[4] * b + r[5] * c, z + r[6] * a + r[7] * b + r[8] * c, points[v]);
    });
    for (let f = 0; f < faces.length; f++) {
      const normal = normals[f];
      if (dot(normal, local) <= reach[f]) continue;
      const [a, b, c] = normal;
      const bright = light(r[0] * a + r[1] * b + r[2] * c, r[3] * a + r[4] * b + r[5] * c, r[6] * a + r[7] * b + r[8] * c);
      const shade = (v) => Math.min(255, Math.round(colours[3 * i + v] * bright));
      pen.fillStyle = `rgb(${shade(0)} ${shade(1)} ${shade(2)})`;
      pen.strokeStyle = edged ? EDGE : pen.fillStyle;
      pen.beginPath();
      faces[f].forEach((v, n) => (n ? pen.lineTo(...points[v]) : pen.moveTo(...points[v])));
      pen.closePath();
      pen.fill();
      pen.stroke();
    }
  }
}

// A soft shadow on the ground: footprints drawn small and let to blur as they are enlarged.
let small = null;
function shadow(modules, numbers, see, width, height) {
  const [w, h] = [Math.ceil(width * SHADOW_SCALE), Math.ceil(height * SHADOW_SCALE)];
  small ??= new OffscreenCanvas(w, h);
  if (small.width !== w || small.height !== h) { small.width = w; small.height = h; }
  const brush = small.getContext("2d", { willReadFrequently: true });
  brush.clearRect(0, 0, w, h);
  brush.fillStyle = "#000";
  const ground = numbers[6];
  const at = [0, 0];
  for (let i = 0; i < modules; i++) {
    const k = 7 + 7 * i;
    brush.beginPath();
    for (const [dx, dy] of [[-0.6, -0.6], [0.6, -0.6], [0.6, 0.6], [-0.6, 0.6]]) {
      see(numbers[k] + dx, numbers[k + 1] + dy, ground, at);
      brush.lineTo(at[0] * SHADOW_SCALE, at[1] * SHADOW_SCALE);
    }
    brush.fill();
  }
  pen.globalAlpha = SHADOW;
  pen.imageSmoothingEnabled = true;
  pen.imageSmoothingQuality = "high";
  pen.drawImage(small, 0, 0, w / SHADOW_SCALE, h / SHADOW_SCALE);
  pen.globalAlpha = 1;
}

// The rotation matrix of a quaternion, row by row.
function turn(w, x, y, z, r) {
  r[0] = 1 - 2 * (y * y + z * z); r[1] = 2 * (x * y - w * z); r[2] = 2 * (x * z + w * y);
  r[3] = 2 * (x * y + w * z); r[4] = 1 - 2 * (x * x + z * z); r[5] = 2 * (y * z - w * x);
  r[6] = 2 * (x * z - w * y); r[7] = 2 * (y * z + w * x); r[8] = 1 - 2 * (x * x + y * y);
}
