// The scene as a point cloud that can be turned, with gripper, arm and objects at the clock's time.

import { getBytes } from './api.js';
import { h } from './dom.js';
import { plural } from './format.js';
import { isPose } from './projection.js';
import { segments } from './segments.js';
import { makeGripper, makeSkeleton, place } from './solids.js';
import { makeStage } from './stage.js';
import * as THREE from './vendor/three.js';

const AROUND = 0.15; // of the objects, metres: seen even where the server knows no arm
const ROBOT = ['arm', 'gripper'];
const FAINT = 0.12; // of the robot's points at times other than their image's
const AUTO = 'with time';

// What a person chose holds for the next episode.
const chosen = { frame: AUTO, camera: '', color: 'rgb' };

/** Returns {node, stop}; without WebGL the panel says so. */
export function makeCloud({ store, row, episode, series, library, clock, signal }) {
  const status = h('p', { class: 'muted', dataset: { testid: 'cloud-status' } });
  const tools = h('div', { class: 'tabs' });
  const place3d = h('div', { class: 'space' });
  const node = h(
    'section',
    { class: 'panel cloud', 'aria-label': 'Point cloud' },
    h('div', { class: 'panel-head' }, h('h2', null, '3-D'), status),
    tools,
    place3d,
    series.links?.note && h('p', { class: 'muted', dataset: { testid: 'arm-note' } }, series.links.note),
  );
  const stage = makeStage(place3d);
  if (!stage) {
    status.textContent = 'This browser shows no WebGL here; all else works without it.';
    place3d.hidden = true;
    return { node, stop() {} };
  }

  const cameras = ['', ...Object.keys(episode.cameras)];
  // Of two episodes beside one another, each has its own.
  const view = { ...chosen, camera: cameras.includes(chosen.camera) ? chosen.camera : '' };
  const loaded = new Map();
  let parts = [];
  let wanted = '';

  const gripper = makeGripper(episode.pad_size);
  const skeleton = makeSkeleton(series.links?.positions);
  const axes = new THREE.AxesHelper(0.06);
  stage.scene.add(gripper.group, axes);
  if (skeleton) stage.scene.add(skeleton.group);
  stage.show(whereabouts(series, episode));

  drawTools();
  clock.onTime(move);

  function frameNow() {
    if (view.frame === AUTO) return clock.isOver ? 1 : 0;
    return view.frame === 'after' ? 1 : 0;
  }

  async function move() {
    const tcp = series.poses.tcp?.[clock.index];
    gripper.group.visible = !clock.isEmpty && isPose(tcp);
    if (gripper.group.visible) gripper.move(tcp, series.poses.gripper_width[clock.index]);
    skeleton?.move(clock.index);
    const target = series.poses.objects?.[0]?.[clock.index] ?? episode.columns.object_rest_pose?.[0];
    axes.visible = isPose(target);
    if (axes.visible) place(axes, target);
    movePoints();
    stage.draw();
    await showCloud(frameNow());
  }

  function movePoints() {
    const frame = frameNow();
    const last = clock.times.length - 1;
    const isTrue = clock.isEmpty || clock.index === (frame ? last : 0);
    for (const part of parts) {
      if (part.isRobot) part.points.material.opacity = isTrue ? 1 : FAINT;
      const way = series.poses.objects?.[part.object];
      if (way) moveBetween(part.points, way[frame ? last : 0], way[clock.index]);
    }
  }

  async function showCloud(frame) {
    const key = `${frame}/${view.camera}/${view.color}`;
    if (wanted === key) return;
    wanted = key;
    const path = `/cloud/${store}/${row}/${frame}?camera=${encodeURIComponent(view.camera)}`;
    try {
      if (!loaded.has(path)) {
        status.textContent = 'Loading …';
        loaded.set(path, getBytes(path, { signal }).then(unpack));
      }
      const cloud = await loaded.get(path);
      if (wanted !== key || stage.isOver()) return;
      removeParts();
      parts = split(cloud, library.labels, view.color);
      for (const { points } of parts) stage.scene.add(points);
      status.textContent = plural(cloud.count, 'point');
      movePoints();
      stage.draw();
    } catch (error) {
      loaded.delete(path);
      if (wanted === key) wanted = '';
      if (error.name !== 'AbortError') status.textContent = error.message;
    }
  }

  function removeParts() {
    for (const { points } of parts) {
      stage.scene.remove(points);
      points.geometry.dispose();
      points.material.dispose();
    }
    parts = [];
  }

  function choose(changes) {
    Object.assign(view, changes);
    Object.assign(chosen, changes);
    drawTools();
    move();
  }

  function drawTools() {
    tools.replaceChildren(
      segments('Points', [AUTO, 'before', 'after'], view.frame, (frame) => choose({ frame })),
      segments('Colour', ['rgb', 'label'], view.color, (color) => choose({ color })),
      cameras.length > 2 ? segments('Camera', cameras, view.camera, (camera) => choose({ camera })) : '',
      h('button', { type: 'button', class: 'small', onclick: stage.reset }, 'Reset view'),
    );
  }

  return {
    node,
    stop() {
      removeParts();
      gripper.dispose();
      skeleton?.dispose();
      axes.dispose();
      stage.stop();
    },
  };
}

/** Corners around the objects where they lie at first, and all places of the arm's links. */
function whereabouts(series, episode) {
  const poses = (episode.columns.object_rest_pose ?? []).filter(isPose);
  const corners = poses.flatMap(([x, y, z]) =>
    [-AROUND, AROUND].flatMap((by) => [
      [x + by, y, z],
      [x, y + by, z],
      [x, y, z + by],
    ]),
  );
  return [...corners, ...(series.links?.positions ?? []).flat().filter(isPose)];
}

function unpack(bytes) {
  const count = new DataView(bytes).getUint32(0, true);
  return {
    count,
    position: new Float32Array(bytes, 4, 3 * count),
    rgb: new Uint8Array(bytes, 4 + 12 * count, 3 * count),
    label: new Uint8Array(bytes, 4 + 15 * count, count),
  };
}

/** Points by what moves them: the scene, the robot, and each object (`object` is its number). */
function split(cloud, labels, color) {
  const target = labels.findIndex(({ name }) => name === 'target');
  const robot = ROBOT.map((word) => labels.findIndex(({ name }) => name === word));
  const parts = new Map();
  cloud.label.forEach((label, i) => {
    if (!cloud.position.subarray(3 * i, 3 * i + 3).every(Number.isFinite)) return;
    const object = label >= target ? label - target : -1;
    const isRobot = robot.includes(label);
    const key = isRobot ? 'robot' : object;
    if (!parts.has(key)) parts.set(key, { object, isRobot, members: [] });
    parts.get(key).members.push(i);
  });
  const byLabel = labels.map((label) => new THREE.Color(label.color));
  // So that the dots meet whatever the resolution of the camera is.
  const size = Math.min(Math.max(1.1 * Math.sqrt(1.2 / Math.max(cloud.count, 1)), 0.003), 0.02);
  return [...parts.values()].map((part) => ({
    ...part,
    points: makePoints(cloud, part.members, color === 'label' ? byLabel : null, size),
  }));
}

function makePoints(cloud, members, byLabel, size) {
  const position = new Float32Array(3 * members.length);
  const color = new Float32Array(3 * members.length);
  const one = new THREE.Color();
  members.forEach((i, k) => {
    position.set(cloud.position.subarray(3 * i, 3 * i + 3), 3 * k);
    const [r, g, b] = cloud.rgb.subarray(3 * i, 3 * i + 3);
    const paint = byLabel?.[cloud.label[i]] ?? one.setRGB(r / 255, g / 255, b / 255, 'srgb');
    paint.toArray(color, 3 * k);
  });
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute('position', new THREE.BufferAttribute(position, 3));
  geometry.setAttribute('color', new THREE.BufferAttribute(color, 3));
  const material = new THREE.PointsMaterial({ size, vertexColors: true, transparent: true });
  return new THREE.Points(geometry, material);
}

/** Carry points that were seen with their object at one pose to where it is at another. */
function moveBetween(points, seen, now) {
  if (!isPose(seen) || !isPose(now)) return;
  const [was, is] = [matrixOf(seen), matrixOf(now)];
  points.matrixAutoUpdate = false;
  points.matrix.copy(is.multiply(was.invert()));
  points.matrixWorldNeedsUpdate = true;
}

function matrixOf([x, y, z, ...quaternion]) {
  return new THREE.Matrix4().compose(
    new THREE.Vector3(x, y, z),
    new THREE.Quaternion(...quaternion),
    new THREE.Vector3(1, 1, 1),
  );
}
