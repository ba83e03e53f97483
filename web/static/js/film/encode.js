// Encoding of a film's pictures as fast as they are drawn, by the browser's WebCodecs.
import { configOf } from "./formats.js";
import { FPS } from "./schedule.js";

const KEY_FRAME_EVERY = 60; // pictures; players seek to them
const MAX_WAITING = 6; // pictures that wait for the encoder
const MICROSECONDS = 1e6;

/**
 * @typedef {object} Making
 * @property {import("./pictures.js").Pictures} pictures
 * @property {AbortSignal} signal
 * @property {(picture: ImageBitmap, done: number) => void} progress
 */

// Return the file of a film.
/**
 * @param {import("./formats.js").Encoding} encoding
 * @param {Making} making
 * @returns {Promise<Blob>}
 */
export async function encode(encoding, { pictures, signal, progress }) {
  const {
    BufferTarget,
    EncodedPacket,
    EncodedVideoPacketSource,
    Mp4OutputFormat,
    Output,
    WebMOutputFormat,
  } = await import("./mediabunny.js");
  const { width, height } = pictures.options;
  const isMp4 = encoding.container === "mp4";
  const target = new BufferTarget();
  const output = new Output({
    format: isMp4 ? new Mp4OutputFormat({ fastStart: "in-memory" }) : new WebMOutputFormat(),
    target,
  });
  const source = new EncodedVideoPacketSource(codecName(encoding.codec));
  output.addVideoTrack(source, { frameRate: FPS });
  await output.start();

  /** @type {unknown} */
  let failure = null;
  /** @type {Promise<unknown>} */
  let stored = Promise.resolve();
  const encoder = new VideoEncoder({
    output: (chunk, meta) => {
      stored = stored.then(() => source.add(EncodedPacket.fromEncodedChunk(chunk), meta));
    },
    error: (error) => {
      failure = error;
    },
  });
  try {
    encoder.configure(configOf(encoding, { width, height }, FPS));
    let next = pictures.at(0);
    for (let k = 0; k < pictures.count; k++) {
      const picture = await next;
      signal.throwIfAborted();
      if (failure) throw failure;
      if (k + 1 < pictures.count) next = pictures.at(k + 1); // drawn while this one is encoded
      next.catch(() => {}); // the loop may end before it waits for it
      const frame = new VideoFrame(picture, {
        timestamp: Math.round((k / FPS) * MICROSECONDS),
        duration: Math.round(MICROSECONDS / FPS),
      });
      encoder.encode(frame, { keyFrame: k % KEY_FRAME_EVERY === 0 });
      frame.close();
      progress(picture, k + 1);
      picture.close();
      while (encoder.encodeQueueSize > MAX_WAITING && !failure)
        await new Promise((done) => {
          encoder.addEventListener("dequeue", done, { once: true });
        });
    }
    await encoder.flush();
    await stored;
    if (failure) throw failure;
    await output.finalize();
  } finally {
    if (encoder.state !== "closed") encoder.close();
  }
  return new Blob([/** @type {ArrayBuffer} */ (target.buffer)], {
    type: `video/${encoding.container}`,
  });
}

/** @param {string} codec */
const codecName = (codec) =>
  codec.startsWith("avc1") ? "avc" : codec.startsWith("vp09") ? "vp9" : "vp8";
