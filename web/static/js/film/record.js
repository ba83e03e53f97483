// Recording of a film in real time, for browsers without WebCodecs and for pages without HTTPS.
import { bitrateOf } from "./formats.js";
import { FPS } from "./schedule.js";

// Return the file of a film. Late pictures are left out, so that the film keeps its length.
/**
 * @param {string} type of the recording
 * @param {import("./encode.js").Making} making
 * @returns {Promise<Blob>}
 */
export async function record(type, { pictures, signal, progress }) {
  const { width, height } = pictures.options;
  const canvas = Object.assign(document.createElement("canvas"), { width, height });
  const pen = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  const recorder = new MediaRecorder(canvas.captureStream(FPS), {
    mimeType: type,
    videoBitsPerSecond: bitrateOf({ width, height }, FPS),
  });
  /** @type {Blob[]} */
  const parts = [];
  recorder.ondataavailable = ({ data }) => parts.push(data);
  const stopped = new Promise((done, failed) => {
    recorder.onstop = done;
    recorder.onerror = () => failed(new Error("The browser stopped recording. Try again."));
  });
  pen.drawImage(await pictures.at(0), 0, 0);
  recorder.start();
  const startMs = performance.now();
  try {
    for (let k = 1; k < pictures.count; k = later(k, startMs, pictures.count)) {
      const picture = await pictures.at(k);
      signal.throwIfAborted();
      pen.drawImage(picture, 0, 0);
      progress(picture, k + 1);
      picture.close();
      const dueMs = startMs + (1000 * (k + 1)) / FPS;
      await new Promise((done) => setTimeout(done, Math.max(0, dueMs - performance.now())));
    }
  } finally {
    recorder.stop();
  }
  await stopped;
  return new Blob(parts, { type: type.split(";")[0] });
}

// Return the picture after picture k that is due; the last one is never left out.
/**
 * @param {number} k
 * @param {number} startMs
 * @param {number} count
 */
function later(k, startMs, count) {
  const due = Math.floor(((performance.now() - startMs) / 1000) * FPS);
  return k < count - 1 ? Math.min(Math.max(k + 1, due), count - 1) : count;
}
