// What a module's colour says. Red alone means joint error, one blue alone means selected, grey means
// that nothing was recorded; all else is told by an even ramp that colour-blind people read as well.

// Shares of a ramp (n), NaN where nothing is known, as 3n sRGB bytes.
export function ramped(shares, ramp, unknown) {
  const last = ramp.length / 3 - 1;
  const colours = new Uint8Array(3 * shares.length);
  for (let i = 0; i < shares.length; i++) {
    const share = shares[i];
    if (Number.isNaN(share)) { colours.set(unknown, 3 * i); continue; }
    const k = 3 * Math.round(Math.min(1, Math.max(0, share)) * last);
    colours[3 * i] = ramp[k]; colours[3 * i + 1] = ramp[k + 1]; colours[3 * i + 2] = ramp[k + 2];
  }
  return colours;
}

export class ErrorColours {
  of(shown, film) {
    const scale = film.outline.error_scale_rad;
    const { header, arrays } = film.scenery;
    return ramped(film.moduleErrors(shown.errors).map((v) => v / scale), arrays.ramp_error, header.colours.unknown);
  }
}
