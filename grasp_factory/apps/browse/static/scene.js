// What happens, drawn over a camera's image: gripper, arm, planned grasp and the target's way.

import { cssColor } from './format.js';
import { isPose, makeView, placed } from './projection.js';

const STEM = 0.1; // metres from the TCP back along the approach
const [TARGET, ARM, GRIPPER, PLANNED, OUTLINE, ...AXES] = [
  ...['--target', '--arm', '--gripper', '--grasp', '--outline', '--axis-x', '--axis-y', '--axis-z'],
].map((name) => cssColor(name));

/** Draw record `index` on a canvas that lies over an image of `camera`, taken at `frame`. */
export function drawScene(canvas, episode, series, camera, frame, index) {
  const ratio = window.devicePixelRatio || 1;
  const width = Math.round(canvas.clientWidth * ratio);
  const height = Math.round(canvas.clientHeight * ratio);
  if (!width || !height) return;
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  const ctx = canvas.getContext('2d');
  ctx.setTransform(1, 0, 0, 1, 0, 0);
  ctx.clearRect(0, 0, width, height);
  ctx.scale(width / camera.width, height / camera.height);
  ctx.lineCap = ctx.lineJoin = 'round';
  const pen = makePen(ctx, makeView(camera, frame), camera.width / width * ratio);

  if (episode.grasp) drawPlanned(pen, episode.grasp);
  if (index < 0) return;
  drawTarget(pen, series.poses.objects?.[0], index);
  const arm = series.links?.positions?.[index];
  if (arm) drawArm(pen, arm);
  const tcp = series.poses.tcp?.[index];
  if (isPose(tcp)) drawGripper(pen, tcp, series.poses.gripper_width[index], episode.pad_size);
}

// `unit` is one CSS pixel in pixels of the image.
function makePen(ctx, view, unit) {
  function stroke(points, color, thickness) {
    ctx.beginPath();
    for (const [from, to] of pairs(points)) {
      const line = view.line(from, to);
      if (!line) continue;
      ctx.moveTo(...line[0]);
      ctx.lineTo(...line[1]);
    }
    ctx.strokeStyle = color;
    ctx.lineWidth = thickness * unit;
    ctx.stroke();
  }
  return {
    line(points, color, thickness = 2, dash = []) {
      ctx.setLineDash(dash.map((length) => length * unit));
      stroke(points, OUTLINE, thickness + 2);
      stroke(points, color, thickness);
      ctx.setLineDash([]);
    },
    dot(point, color, radius = 3) {
      const at = view.point(point);
      if (!at) return;
      ctx.beginPath();
      ctx.arc(...at, radius * unit, 0, 2 * Math.PI);
      ctx.fillStyle = color;
      ctx.fill();
      ctx.strokeStyle = OUTLINE;
      ctx.lineWidth = unit;
      ctx.stroke();
    },
  };
}

function pairs(points) {
  return points.slice(1).map((point, i) => [points[i], point]);
}

function drawPlanned(pen, grasp) {
  const pose = [...grasp.position, ...grasp.quat_xyzw];
  if (!isPose(pose)) return;
  const half = (grasp.width ?? 0) / 2;
  pen.line([placed(pose, [0, half, 0]), placed(pose, [0, -half, 0])], PLANNED, 1.5, [4, 4]);
  pen.line([placed(pose, [0, 0, 0]), placed(pose, [0, 0, -STEM / 2])], PLANNED, 1.5, [4, 4]);
}

function drawTarget(pen, poses, index) {
  const now = poses?.[index];
  if (!isPose(now)) return;
  const way = poses.slice(0, index + 1).filter(isPose).map((pose) => pose.slice(0, 3));
  if (way.length > 1) pen.line(way, TARGET, 1.5);
  [[0.04, 0, 0], [0, 0.04, 0], [0, 0, 0.04]].forEach((tip, i) =>
    pen.line([now.slice(0, 3), placed(now, tip)], AXES[i], 1.5),
  );
  pen.dot(now.slice(0, 3), TARGET);
}

function drawArm(pen, points) {
  pen.line(points, ARM, 2);
  for (const point of points) pen.dot(point, ARM, 2.5);
}

function drawGripper(pen, tcp, width, padSize) {
  const half = (width ?? 0) / 2;
  const reach = (padSize?.[1] ?? 0.04) / 2;
  pen.line([placed(tcp, [0, 0, 0]), placed(tcp, [0, 0, -STEM])], GRIPPER, 2.5);
  pen.line([placed(tcp, [0, half, 0]), placed(tcp, [0, -half, 0])], GRIPPER, 2.5);
  for (const y of [half, -half]) {
    pen.line([placed(tcp, [0, y, -reach]), placed(tcp, [0, y, reach])], GRIPPER, 5);
  }
}

/** The legend of what drawScene draws: [[colour, words], ...]. */
export const SCENE_KEYS = [
  [GRIPPER, 'gripper'],
  [ARM, 'arm'],
  [TARGET, 'target and its way'],
  [PLANNED, 'planned grasp'],
];
