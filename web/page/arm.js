// What an arm senses, and what its actuators are sent for a command: Python's `Arm.state` and `Arm.command`.
// `angles` and other places are those in MuJoCo's data.
function makeArm({ angles, muscles }) {
  const theta = ({ qpos }) => angles.map((k) => qpos[k]);
  if (!muscles) return { theta, sense: (data) => [...theta(data), ...angles.map((k) => data.qvel[k])], sent: (u) => u };

  const { rotors, tendons, moment_arms: momentArms, tension_bias: bias, motor_stiffness: motor } = muscles;
  const { spring_linear: linear, spring_cubic: cubic } = muscles;
  // Pull of a spring [N] that is stretched by so much [m], and the stretch at which it pulls so: the real root of a cubic.
  const pull = (stretch) => linear * stretch + cubic * stretch ** 3;
  function stretch(tension) {
    const a = Math.sqrt(linear / (3 * cubic));
    return 2 * a * Math.sinh(Math.asinh(tension / (2 * cubic * a ** 3)) / 3);
  }
  // Tensions and lengths of the muscles.
  function sense({ qpos, ten_length: lengths }) {
    return [...tendons.map((k) => pull(Math.max(lengths[k], 0))), ...rotors.map((k) => -qpos[k])];
  }
  // To each motor a position, and a force in addition.
  function sent([shoulder, elbow, tension]) {
    const shorter = stretch(tension) + (tension - bias) / motor;
    return momentArms.flatMap(([a, b]) => [shorter - a * shoulder - b * elbow, bias]);
  }
  return { theta, sense, sent };
}
