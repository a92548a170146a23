// The words of the outputs, said to people.

const REASONS = {
  few_satellites: "too few satellites",
  few_antennas: "fewer than two antennas have observations",
  no_ephemeris: "no ephemerides yet for the satellites in view",
  no_phase: "no carrier phase",
  time_mismatch: "the antennas are not sampled together",
  weak_model: "too few signals for certain integers",
  ratio: "two solutions are almost equally good",
  success_rate: "the integers are not certain enough",
  length: "the baseline does not have its known length",
  geometry: "the baselines do not fit the array",
  tilt: "the body would tilt more than it can",
  residuals: "the phases do not fit together",
  two_minima: "two attitudes fit equally well",
  closure: "the baselines do not close",
  budget: "the search for integers was too long",
  slip: "too many phases slipped",
  bad_input: "observations that cannot be used",
  unproven: "a first fix that nothing confirms yet",
  contradiction: "integers disagree between epochs",
  interference: "a receiver states that satellites are imitated (spoofing)",
  predicted: "carried by the gyro",
  peer_silent: "nothing came from it for too long",
  peer_time: "its time is another one",
  no_rows: "no rows came",
};

export const reason = (word) => REASONS[word] ?? word;

// 0.3 s, 12 s, 3 min 20 s, 2 h 5 min
export function duration(seconds) {
  if (seconds < 10) return `${seconds.toFixed(1)} s`;
  const whole = Math.round(seconds);
  if (whole < 60) return `${whole} s`;
  if (whole < 3600) return `${Math.floor(whole / 60)} min ${whole % 60} s`;
  return `${Math.floor(whole / 3600)} h ${Math.floor((whole % 3600) / 60)} min`;
}

// Metres with as many places as their size deserves.
export const metres = (value) => `${value.toFixed(Math.abs(value) < 10 ? 2 : 1)} m`;

// Writes a text only where it is another one, so that nothing is laid out in vain.
export function write(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

export const byId = (id) => document.getElementById(id);
