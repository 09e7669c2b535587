// Sliders' places and values: linear, logarithmic, and logarithmic on both sides of zero where the range spans it.

/** Steps of a slider from end to end. */
export const STEPS = 1000;
/** How many times further a slider goes beyond a value at its end, on a logarithmic scale. */
const FURTHER = 3;

/** {place(value) → 0..STEPS, value(place, fine)}; values have the digits that a person would write, one more where it is `fine`. */
export function makeScale({ minimum: low, maximum: high, integer, scale, step }) {
  const knee = Math.max(Math.abs(low), Math.abs(high)) / 1000;
  const both = scale === "log" && low <= 0;
  const bend = scale !== "log" ? [(x) => x, (y) => y] : both ? [(x) => Math.asinh(x / knee), (y) => knee * Math.sinh(y)] : [Math.log, Math.exp];
  const first = bend[0](low);
  const last = bend[0](high);
  return {
    place: (value) => (STEPS * (bend[0](Math.min(high, Math.max(low, value))) - first)) / (last - first),
    value(place, fine = false) {
      if (place <= 0) return low;
      if (place >= STEPS) return high;
      const exact = bend[1](first + ((last - first) * place) / STEPS);
      const beside = bend[1](first + ((last - first) * (place + (fine ? 0.1 : 1))) / STEPS);
      // round zero, where its steps are smallest, no finer than what exact entry counts in
      const least = both && step ? step / 10 : 0;
      return Math.min(high, Math.max(low, tidy(exact, Math.max(least, Math.abs(beside - exact)), integer)));
    },
  };
}

/**
 * The ends of a slider for a value: its travel; where the value lies at or beyond an end, as much further as to leave room
 * to turn it both ways, a half of the travel or a factor, but no further than what is allowed.
 */
export function travelFor({ minimum, maximum, scale }, [low, high], value) {
  const further = (from, towards, limit, way) => {
    const factor = scale === "log" && from > 0 && towards > 0 ? FURTHER ** way : null;
    const wanted = factor === null ? from + (way * Math.max(Math.abs(high - low), Math.abs(from - towards))) / 2 : from * factor;
    return Number.isFinite(limit) ? (way > 0 ? Math.min(limit, wanted) : Math.max(limit, wanted)) : wanted;
  };
  return {
    minimum: value <= low ? Math.min(low, further(value, low, minimum, -1)) : low,
    maximum: value >= high ? Math.max(high, further(value, high, maximum, 1)) : high,
  };
}

/** The value with no more digits than tell it from its neighbour at `distance`; whole where it must be. */
function tidy(value, distance, integer) {
  if (integer) return Math.round(value);
  const unit = 10 ** Math.floor(Math.log10(distance || 1));
  return Number((Math.round(value / unit) * unit).toPrecision(12));
}

/** How far an arrow key moves a number: a hundredth of it, rounded to 1, 2 or 5 of its digit; whole where it must be. */
export function keyStep(value, { step, integer }) {
  if (integer) return 1;
  const size = Math.abs(value) / 100 || step || 0.01;
  const digit = 10 ** Math.floor(Math.log10(size));
  const lead = size / digit;
  return digit * (lead < 1.5 ? 1 : lead < 3.5 ? 2 : 5);
}

/** What is typed into a number field; NaN where it is no number. Comma and real minus sign are taken. */
export function parseNumber(text) {
  const clean = text.trim().replaceAll("−", "-").replace(",", ".");
  return /^[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?$/i.test(clean) ? Number(clean) : NaN;
}
