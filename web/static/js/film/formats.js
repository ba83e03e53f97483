// Formats of films: what this browser can encode, in order of preference.

/**
 * @typedef {{ codec: string, container: "mp4" | "webm" }} Encoding
 * @typedef {{ width: number, height: number }} Size
 */

// H.264 plays everywhere; VP9 and VP8 are for browsers without it.
/** @type {Encoding[]} */
export const ENCODINGS = [
  { codec: "avc1.640028", container: "mp4" },
  { codec: "avc1.4d0028", container: "mp4" },
  { codec: "avc1.420028", container: "mp4" },
  { codec: "vp09.00.40.08", container: "webm" },
  { codec: "vp8", container: "webm" },
];
// Types of recordings, for browsers that only record what a canvas shows.
export const RECORDINGS = [
  "video/mp4;codecs=avc1.640028",
  "video/mp4;codecs=avc1.42E01F",
  "video/webm;codecs=vp9",
  "video/webm;codecs=vp8",
  "video/webm",
  "video/mp4",
];
const BITS_PER_PIXEL = 0.1; // enough for smooth surfaces and text; chosen by eye

/**
 * @param {Size} size
 * @param {number} fps
 */
export const bitrateOf = ({ width, height }, fps) =>
  Math.round(width * height * fps * BITS_PER_PIXEL);

/**
 * @param {Encoding} encoding
 * @param {Size} size
 * @param {number} fps
 * @returns {VideoEncoderConfig}
 */
export const configOf = ({ codec }, size, fps) => ({
  codec,
  ...size,
  framerate: fps,
  bitrate: bitrateOf(size, fps),
  latencyMode: "quality",
  ...(codec.startsWith("avc1") && { avc: { format: "avc" } }),
});

// Return the best supported encoding of each container, the most widely played one first.
/**
 * @param {Encoding[]} supported
 * @returns {Encoding[]}
 */
export function offered(supported) {
  const usable = ENCODINGS.filter(({ codec }) => supported.some((other) => other.codec === codec));
  return usable.filter(
    ({ container }, k) => usable.findIndex((other) => other.container === container) === k,
  );
}

// Return what this browser can encode at a size; nothing where WebCodecs is missing.
/**
 * @param {Size} size
 * @param {number} fps
 */
export async function encodingsFor(size, fps) {
  if (!("VideoEncoder" in globalThis)) return [];
  const answers = await Promise.all(
    ENCODINGS.map((encoding) =>
      VideoEncoder.isConfigSupported(configOf(encoding, size, fps)).then(
        ({ supported }) => Boolean(supported),
        () => false,
      ),
    ),
  );
  return offered(ENCODINGS.filter((_, k) => answers[k]));
}

// Return the type of a recording; null if this browser cannot record a canvas.
export function recordingType() {
  if (!("MediaRecorder" in globalThis) || !("captureStream" in HTMLCanvasElement.prototype))
    return null;
  return RECORDINGS.find((type) => MediaRecorder.isTypeSupported(type)) ?? null;
}
