// Colours of what is drawn. Blue, orange and brown stay apart for eyes that confuse red and green; what matters is told
// by dashes and shapes too.

const PALETTES = {
  light: {
    ink: '#1b1f27', halo: '#ffffff', trajectory: '#1668d6', odometry: '#a0714f', truth: '#1b1f27', observation: '#66a9b5',
    loop: '#e8590c', prior: '#c2255c', marginal: '#8a6d9b', rejected: '#c2255c', doubted: '#c2255c', landmark: '#0b7285', ellipse: '#7048e8',
    scan: '#0b7285', other: '#e8590c', select: '#111318', stage: [228, 230, 234], free: [255, 255, 255],
    occupied: [20, 23, 29], grid: '#d4d3cc', robots: ['#1668d6', '#c96a00', '#0b7d5c', '#b0308f', '#6b5200', '#5a6472'],
  },
  dark: {
    ink: '#e8eaee', halo: '#12151b', trajectory: '#5ea0ff', odometry: '#c79a78', truth: '#e8eaee', observation: '#4b8f9c',
    loop: '#ff9a52', prior: '#ff7aa8', marginal: '#bfa6d0', rejected: '#ff7aa8', doubted: '#ff7aa8', landmark: '#5fd0e0', ellipse: '#b197fc',
    scan: '#5fd0e0', other: '#ff9a52', select: '#ffffff', stage: [32, 37, 46], free: [52, 59, 71],
    occupied: [236, 238, 242], grid: '#363d4a', robots: ['#5ea0ff', '#ffb35c', '#5fd6b0', '#f08ad6', '#d8c26a', '#aab3c0'],
  },
};

let colours = PALETTES.light;

/** Colour of a robot's path. */
const colourOf = (robot) => colours.robots[robot % colours.robots.length];

/** @param {'light' | 'dark'} theme */
function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  colours = PALETTES[theme];
}

const systemDark = window.matchMedia('(prefers-color-scheme: dark)');
setTheme(systemDark.matches ? 'dark' : 'light');
