// How the panel looks: in a notebook, and on a projector, where all sizes follow the height of the page.
const STYLE = `
.clothlab { font: 15px/1.4 system-ui, sans-serif; color: #1a1a1a; background: #fff; color-scheme: light; padding: 8px; }
.clothlab, .clothlab * { box-sizing: border-box; }
.clothlab figure { margin: 0; }
.clothlab .row { display: flex; flex-wrap: wrap; gap: 8px; align-items: center; }
.clothlab .columns { display: flex; flex-wrap: wrap; gap: 12px; align-items: flex-start; margin-top: 8px; }
.clothlab section { flex: 1 1 var(--least); min-width: min(100%, var(--least)); max-width: 600px; border-top: 2px solid #0072B2; padding-top: 4px; }
.clothlab .traces { flex: 1 1 390px; }
.clothlab img, .clothlab canvas.drawn { max-width: 100%; }
.clothlab canvas.drawn { width: var(--wide); }
.clothlab .pair { flex-wrap: nowrap; align-items: flex-start; }
.clothlab .pair > figure { flex: 0 1 196px; min-width: 0; }
.clothlab section > .row { margin-top: 6px; }
.clothlab h3 { font-size: 1.07em; margin: 2px 0 6px; padding: 0; }
.clothlab button, .clothlab select, .clothlab input[type=text] { font: inherit; padding: 3px 10px; border: 1px solid #888; border-radius: 4px; background: #f6f6f6; color: inherit; }
.clothlab button:hover:not(:disabled, [aria-pressed=true]) { background: #e8f1f8; }
.clothlab button[aria-pressed=true] { background: #0072B2; border-color: #0072B2; color: #fff; }
.clothlab button.picture { padding: 0; border: 2px solid #ccc; line-height: 0; }
.clothlab button[aria-pressed=true]:disabled { background: #f6f6f6; border-color: #888; color: inherit; }
.clothlab :disabled, .clothlab [aria-disabled=true] { opacity: 0.45; cursor: not-allowed; }
.clothlab label.slider:has(:disabled) { color: #767676; }
.clothlab :focus-visible { outline: 3px solid #E69F00; outline-offset: 1px; }
.clothlab label.slider { display: grid; grid-template-columns: 10em minmax(50px, 1fr) 3.4em; gap: 5px; align-items: center; white-space: nowrap; }
.clothlab label.slider input { width: 100%; min-width: 0; }
.clothlab .key { display: inline-block; white-space: nowrap; }
.clothlab label.slider output { text-align: right; font-variant-numeric: tabular-nums; }
.clothlab .status { font-weight: 600; padding: 2px 12px; border-radius: 12px; background: #e4e4e4; }
.clothlab .status.running { background: #007a59; color: #fff; }
.clothlab .status.late { background: #E69F00; color: #000; }
.clothlab .message { min-height: 1.5em; overflow-wrap: anywhere; margin: 6px 0; padding: 1px 8px; border-left: 4px solid transparent; }
.clothlab .message.info:not(:empty) { border-color: #0072B2; }
.clothlab .message.mistake { border-color: #E69F00; background: #fdf3dd; }
.clothlab .message.fault { border-color: #b00020; color: #b00020; background: #fdecee; font-weight: 600; }
.clothlab .lines { white-space: pre-line; }
.clothlab .note { color: #444; font-size: 0.94em; margin: 4px 0; }
.clothlab .inactive label { color: #666; }
.clothlab .inactive input { accent-color: #666; }
.clothlab canvas.plot { display: block; width: 100%; height: 120px; font-size: 14px; }
.clothlab .distance canvas.plot { height: 170px; }
.clothlab .key canvas { width: 2em; height: 0.8em; margin: 0 0.3em 0 0.8em; }
.clothlab input[type=checkbox] { width: 0.9em; height: 0.9em; }
.clothlab button.picture canvas { width: 3.9em; }
.clothlab canvas.map { font-size: 14px; }
.clothlab figure.aim { flex: none; }
.clothlab .folds, .clothlab .drawer { display: none; }
.clothlab .beside { display: flex; flex-wrap: wrap; gap: 8px; }
.clothlab .beside > div { flex: 1 1 150px; min-width: 0; }
.clothlab .no { color: #b00020; font-weight: 600; }
.clothlab.projector { position: fixed; inset: 0; width: 100vw; height: 100vh; max-width: none; max-height: none; margin: 0; border: 0; padding: 1vh 1.4vh; overflow: hidden; display: flex; flex-direction: column; gap: 0.8vh; font-size: 2.7vh; line-height: 1.25; }
.clothlab.projector > .columns { display: none; }
.clothlab.projector button, .clothlab.projector select { padding: 0.3vh 1.1vh; }
.clothlab.projector .row { gap: 0.8vh; }
.clothlab.projector .status { padding: 0.3vh 2vh; }
.clothlab.projector .away { margin-left: auto; }
.clothlab.projector .folds { display: flex; align-items: flex-start; }
.clothlab.projector .folds > .row { flex: none; }
.clothlab.projector .message { flex: 1; min-height: 0; max-height: 40vh; overflow-y: auto; margin: 0; }
.clothlab.projector > .message:empty { display: none; }
.clothlab.projector .stage { flex: 1; min-height: 0; margin: 0; display: grid; grid-template: minmax(47vh, auto) minmax(0, 1fr) / repeat(3, minmax(0, 1fr)); gap: 0.8vh 1.4vh; }
.clothlab.projector .stage > figure:nth-child(1) { grid-area: 1 / 1; }
.clothlab.projector .stage > figure:nth-child(2) { grid-area: 1 / 2; }
.clothlab.projector .stage > figure:nth-child(3) { grid-area: 1 / 3; --target: min(100%, 57vh); }
.clothlab.projector .stage > figure > :is(img, canvas.drawn) { display: block; width: min(100%, 57vh); aspect-ratio: 4 / 3; }
.clothlab.projector .stage > figure > figcaption { display: flex; flex-wrap: wrap; gap: 0 1.5vh; }
.clothlab.projector .stage > .traces { grid-area: 2 / 1 / 3 / -1; min-height: 0; display: flex; flex-direction: column; }
.clothlab.projector .stage > .traces > figure { flex: 1; min-height: 0; display: flex; flex-direction: column; }
.clothlab.projector .stage > .traces canvas.plot { flex: 1; min-height: 0; height: auto; }
.clothlab.projector canvas.plot, .clothlab.projector canvas.map { font-size: 2.5vh; }
.clothlab.projector .drawer:not(:empty) { display: block; grid-area: 1 / 2 / 2 / 4; background: #fff; overflow: auto; height: 0; min-height: 100%; padding: 0 1vh; border: 0.3vh solid #0072B2; z-index: 1; }
.clothlab.projector .drawer.left { grid-area: 1 / 1 / 2 / 3; }
.clothlab.projector .drawer section { max-width: none; border: 0; margin: 0; padding: 0; }
.clothlab.projector .drawer { --map: 44vh; }
.clothlab.projector .drawer section.split { display: grid; grid-template-columns: minmax(0, 1fr) auto; gap: 0 1.4vh; }
.clothlab.projector .drawer section.halves { grid-template-columns: repeat(2, minmax(0, 1fr)); }
.clothlab.projector .drawer section.halves:has(> [hidden]) { grid-template-columns: 1fr; }
.clothlab.projector .drawer .beside > div:first-child { flex: none; }
.clothlab.projector .drawer img.ellipse { width: 32vh; }
.clothlab.projector .drawer .beside :is(img, canvas.drawn) { width: 25vh; height: auto; }
.clothlab.projector .drawer canvas.plot { height: 18.5vh; }
.clothlab.projector .drawer label.slider { grid-template-columns: 10.5em minmax(3em, 1fr) 3.2em; }
.clothlab.projector .drawer h3 { margin: 0.4vh 0; }
`;
