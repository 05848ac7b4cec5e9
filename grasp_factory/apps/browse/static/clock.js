// The time of an attempt that a page shows: a record of the streams, moved by hand or playing.

const ROUNDED = 1e-4; // seconds; the times of records come rounded, those of phases do not
export const SPEEDS = [1, 0.25];

/** Series of an episode that has none. */
export const NOTHING = { time: [], imu_time: [], video_time: [], phases: [], groups: [], poses: {}, links: null, tactile: null };

/** Whether the times of an episode's series are as a clock tells them. */
export function inOrder(series) {
  return [series.time, series.imu_time, series.video_time].every((times) =>
    times.every((time, i) => Number.isFinite(time) && (i === 0 || time >= times[i - 1])),
  );
}

/**
 * times: seconds of the records, ascending; empty where nothing was recorded.
 * Listeners are called with the clock: onTime after each move, onPlay when playing starts or ends.
 */
export function makeClock(times) {
  const moved = new Set();
  const switched = new Set();
  let frame = 0;
  let before = 0;

  const clock = {
    times,
    index: 0,
    time: times[0] ?? 0,
    start: times[0] ?? 0,
    end: times.at(-1) ?? 0,
    speed: 1,
    playing: false,
    isEmpty: times.length === 0,

    seek(time) {
      if (clock.isEmpty) return;
      clock.time = Math.min(Math.max(time, clock.start), clock.end);
      clock.index = nearest(times, clock.time);
      for (const f of moved) f(clock);
    },

    /** Move by so many records, onto a record. */
    step(records) {
      clock.pause();
      const last = times.length - 1;
      clock.seek(times[Math.min(Math.max(clock.index + records, 0), last)]);
    },

    get isOver() {
      return !clock.isEmpty && clock.index === times.length - 1;
    },

    play() {
      if (clock.playing || clock.isEmpty) return;
      if (clock.isOver) clock.seek(clock.start);
      set(true);
      before = performance.now();
      frame = requestAnimationFrame(tick);
    },

    pause() {
      cancelAnimationFrame(frame);
      set(false);
    },

    toggle() {
      if (clock.playing) clock.pause();
      else clock.play();
    },

    onTime(f) {
      moved.add(f);
      f(clock);
    },

    onPlay(f) {
      switched.add(f);
      f(clock);
    },

    stop() {
      cancelAnimationFrame(frame);
      moved.clear();
      switched.clear();
    },
  };

  function set(playing) {
    if (clock.playing === playing) return;
    clock.playing = playing;
    for (const f of switched) f(clock);
  }

  function tick(now) {
    clock.seek(clock.time + (Math.max(0, now - before) / 1000) * clock.speed);
    before = now;
    if (clock.time >= clock.end) clock.pause();
    else frame = requestAnimationFrame(tick);
  }

  return clock;
}

/** The index of the value that is nearest to x in an ascending list; -1 for an empty one. */
export function nearest(values, x) {
  const after = firstAbove(values, x);
  if (after === 0) return values.length ? 0 : -1;
  if (after === values.length) return after - 1;
  return x - values[after - 1] <= values[after] - x ? after - 1 : after;
}

/** The index of the last value that is not above x; -1 where all are. */
export function lastUntil(values, x) {
  return firstAbove(values, x) - 1;
}

function firstAbove(values, x) {
  let low = 0;
  let high = values.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (values[middle] <= x) low = middle + 1;
    else high = middle;
  }
  return low;
}

/** The phase that a time belongs to, or null. */
export function phaseAt(phases, time) {
  for (let i = phases.length - 1; i >= 0; i--) {
    if (time >= phases[i].start - ROUNDED) return time <= phases[i].end + ROUNDED ? phases[i] : null;
  }
  return null;
}
