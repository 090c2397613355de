// @ts-check
// A short tick for a reading, two tones for a lost beam; silent until a person has touched the page.
let context = null;

export const quiet = () => localStorage.getItem("sound") === "off";
export const hush = (off) => localStorage.setItem("sound", off ? "off" : "on");

document.addEventListener(
  "pointerdown",
  () => {
    context ??= new AudioContext();
  },
  { once: true },
);

function tone(hertz, begin, seconds, loudness) {
  if (!context || quiet()) return;
  const [oscillator, gain] = [context.createOscillator(), context.createGain()];
  oscillator.frequency.value = hertz;
  gain.gain.value = loudness;
  oscillator.connect(gain).connect(context.destination);
  oscillator.start(context.currentTime + begin);
  oscillator.stop(context.currentTime + begin + seconds);
}

export const click = () => tone(1400, 0, 0.03, 0.1);

export function loss() {
  tone(700, 0, 0.2, 0.25);
  tone(440, 0.22, 0.35, 0.25);
}
