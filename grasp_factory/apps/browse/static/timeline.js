// The slider over an attempt, with its phases below, and what plays and steps it.

import { SPEEDS, phaseAt } from './clock.js';
import { h } from './dom.js';
import { readable } from './format.js';

/**
 * lanes: [{name, phases: [{name, start, end}]}], one row of bands each.
 * Returns {node, slider}; the clock's own listeners end with clock.stop().
 */
export function makeTimeline(clock, lanes, phaseNames) {
  const play = h('button', {
    type: 'button',
    class: 'play primary',
    dataset: { testid: 'play' },
    onclick: () => clock.toggle(),
  });
  const speed = h('button', {
    type: 'button',
    class: 'speed',
    title: 'Speed of playing',
    dataset: { testid: 'speed' },
    onclick: () => {
      clock.speed = SPEEDS[(SPEEDS.indexOf(clock.speed) + 1) % SPEEDS.length];
      showSpeed();
    },
  });
  const slider = h('input', {
    type: 'range',
    min: 0,
    max: Math.max(clock.times.length - 1, 0),
    step: 1,
    disabled: clock.isEmpty,
    'aria-label': 'Time in the attempt',
    dataset: { testid: 'slider' },
    oninput: () => {
      clock.pause();
      clock.seek(clock.times[Number(slider.value)]);
    },
  });
  const time = h('output', { class: 'time', dataset: { testid: 'time' } });
  const phase = h('span', { class: 'phase', dataset: { testid: 'phase' } });

  function showSpeed() {
    speed.textContent = `${clock.speed}×`;
    speed.setAttribute('aria-label', `Speed ${clock.speed}`);
  }

  function showTime() {
    const words = lanes.map((lane) => phaseWord(lane.phases, clock)).join(' | ');
    slider.value = clock.index;
    slider.setAttribute('aria-valuetext', `${clock.time.toFixed(2)} s, ${words}`);
    time.textContent = `${clock.time.toFixed(3)} s`;
    phase.textContent = words;
    const names = lanes.map((lane) => phaseAt(lane.phases, clock.time)?.name);
    phase.dataset.phase = phaseNames.indexOf(names.find(Boolean) ?? '');
  }

  const step = (records, label, text) =>
    h(
      'button',
      {
        type: 'button',
        class: 'step',
        'aria-label': label,
        title: label,
        disabled: clock.isEmpty,
        onclick: () => clock.step(records),
      },
      text,
    );

  const node = h(
    'section',
    { class: 'timeline', 'aria-label': 'Time' },
    h(
      'div',
      { class: 'timeline-keys' },
      step(-1, 'One record back ([)', '‹'),
      play,
      step(1, 'One record on (])', '›'),
      speed,
    ),
    h('div', { class: 'timeline-now' }, time, phase),
    h(
      'div',
      { class: 'timeline-track' },
      slider,
      lanes.map((lane) => bands(lane, clock, phaseNames)),
    ),
  );
  play.disabled = clock.isEmpty;
  showSpeed();
  clock.onPlay(() => {
    play.textContent = clock.playing ? '❚❚' : '▶';
    play.setAttribute('aria-label', clock.playing ? 'Pause (space)' : 'Play (space)');
  });
  clock.onTime(showTime);
  return { node, slider };
}

function phaseWord(phases, clock) {
  if (clock.isEmpty) return 'no records';
  return readable(phaseAt(phases, clock.time)?.name ?? '–');
}

function bands(lane, clock, phaseNames) {
  const row = h('div', { class: 'bands', 'aria-hidden': 'true', title: lane.name || null });
  const length = clock.end - clock.start || 1;
  for (const { name, start, end } of lane.phases) {
    const band = h(
      'span',
      {
        class: 'band',
        title: `${readable(name)}: ${start.toFixed(2)} to ${end.toFixed(2)} s`,
        dataset: { phase: phaseNames.indexOf(name) },
        onclick: () => clock.seek(start),
      },
      readable(name),
    );
    band.style.left = `${(100 * (start - clock.start)) / length}%`;
    band.style.width = `${(100 * (end - start)) / length}%`;
    row.append(band);
  }
  return row;
}
