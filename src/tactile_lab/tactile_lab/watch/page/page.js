'use strict';
/* The live page. It receives frames over a WebSocket, and sends commands over it. */

(() => {
  const $ = (id) => document.getElementById(id);
  const token = location.hash.slice(1);
  const protocols = [...new Set(['tactile', token])].filter((name) => /^[\w-]+$/.test(name));  // WebSocket rejects other names
  const fingers = new Map();
  const SILENT_MS = 1500;
  const RETRY_MS = 5000;  // if nothing is received for this time, the page connects again
  const CONFIRMED_MS = 20000;  // time for which the confirmation of Stop is shown
  let state = null;
  let socket = null;
  let heard = -Infinity;  // time of the last frame
  let tried = 0;  // time of the last attempt to connect
  let stopped = null;  // the last Stop that was pressed on this page
  let dirty = false;

  function set(element, text) {
    if (element.textContent !== text) element.textContent = text;
  }

  function name(element, text) {
    if (element.getAttribute('aria-label') !== text) element.setAttribute('aria-label', text);
  }

  function make(tag, text, className) {
    const element = document.createElement(tag);
    if (text !== undefined) element.textContent = text;
    if (className) element.className = className;
    return element;
  }

  /* ---- one finger ---- */

  class Finger {
    constructor(name) {
      this.name = name;
      this.root = $('finger').content.firstElementChild.cloneNode(true);
      this.find = (selector) => this.root.querySelector(selector);
      set(this.find('.name'), name || 'Finger');
      $('fingers').append(this.root);
      this.tension = new TensionPlot(this.find('.tension-plot'));
      this.spectrum = new SpectrumPlot(this.find('.spectrum-plot'));
      this.hold = new HoldPlot(this.find('.hold-plot'));
      this.epoch = null;
      this.heard = null;
    }

    takeLive(live) {
      if (live.epoch !== this.epoch) this.tension.begin();
      this.epoch = live.epoch;
      this.tension.add(live.x, live.y);
      this.heard = performance.now();
      if (live.spectrum !== undefined) this.newDetail = { plot: this.spectrum, data: live.spectrum };
      if (live.hold !== undefined) this.newDetail = { plot: this.hold, data: live.hold };
    }

    takeState(finger) {
      this.state = finger;
      const trial = finger.trial;
      const phase = this.find('.phase');
      const name = trial ? trial.phase : 'no trial';
      phase.className = `phase ${trial ? name : ''}`;
      set(phase, trial && trial.detected ? `${name} (detected)` : name);
      set(this.find('.rate'), finger.rate_hz ? `${finger.rate_hz} Hz` : '');
      this.tension.spans = finger.spans;
      this.tension.window = finger.window;
      const about = trial ? [trial.object && `object ${trial.object}`, trial.session && `session ${trial.session}`,
        trial.contact, `trial ${trial.id}`] : [];
      this.find('.about').hidden = !about.length;
      set(this.find('.about'), about.filter(Boolean).join(' \u00b7 '));
      // Without models there are no predictions, so the panel is hidden.
      this.find('.answer').hidden = !finger.has_models;
      this.find('.panels').classList.toggle('single', !finger.has_models);
      this.showAnswer(finger, trial);
    }

    showAnswer(finger, trial) {
      const answer = finger.answers[finger.answers.length - 1];
      const panel = this.find('.answer');
      const label = this.find('.label');
      const verdict = this.find('.verdict');
      if (!answer) {
        set(this.find('.task'), 'Prediction');
        set(label, '\u2013');
        set(verdict, trial && trial.runs ? 'trial in progress' : 'no prediction yet');
        return;
      }
      const old = Boolean(trial && trial.runs && trial.id !== answer.trial);
      panel.classList.toggle('old', old);
      const words = [answer.task, answer.contact, `window of ${answer.seconds} s`];
      set(this.find('.task'), (old ? 'Previous trial: ' : '') + words.filter(Boolean).join(', '));
      label.classList.toggle('unknown', answer.outcome !== 'label');
      set(label, { label: answer.label, unknown: 'unknown', no_features: 'no prediction' }[answer.outcome]);
      verdict.className = `verdict ${answer.right === true ? 'right' : answer.right === false ? 'wrong' : ''}`;
      if (answer.right === true) set(verdict, '\u2713 correct');
      else if (answer.right === false) set(verdict, `\u2717 wrong, it is ${answer.true}`);
      else set(verdict, answer.outcome === 'label' ? '' : answer.reason);
      this.showScores(answer);
      const notes = [`model ${answer.model}${answer.simulated ? ', SIMULATED' : ''}`];
      for (const other of finger.answers.slice(0, -1)) {
        if (other.trial !== answer.trial || other.task !== answer.task) continue;
        notes.push(`model ${other.model}, ${other.seconds} s: ${other.outcome === 'label' ? other.label : other.reason}`);
      }
      set(this.find('.note'), notes.join(' \u00b7 '));
    }

    showScores(answer) {
      const body = this.find('.scores tbody');
      const shown = answer.scores.slice(0, 5);
      const high = answer.kind === 'margin' ? Math.max(...shown.map((s) => Math.abs(s[1])), 1e-9) : 1;
      body.replaceChildren(...shown.map(([name, score]) => {
        const row = make('tr');
        const track = make('div', '', 'track');
        const fill = make('div', '', 'fill');
        fill.style.width = `${100 * Math.max(0, Math.min(1, score / high))}%`;
        track.append(fill);
        const middle = make('td');
        middle.append(track);
        const value = answer.kind === 'margin' ? score.toFixed(2) : `${(100 * score).toFixed(0)} %`;
        row.append(make('td', name), middle, make('td', value));
        return row;
      }));
    }

    draw() {
      this.tension.draw();
      if (this.newDetail) {
        const { plot, data } = this.newDetail;
        const isHold = plot === this.hold;
        this.find('.spectrum-plot').hidden = isHold;
        this.find('.hold-plot').hidden = !isHold;
        plot.draw(data);
        set(this.find('.quantity'), isHold ? 'Tension [N] over time in the hold [s]' : 'Amplitude [mN] over frequency [Hz]');
        const empty = isHold ? 'no hold yet' : 'too few samples yet';
        const line = isHold && data ? `, slope ${data.slope_n_s} N/s` : '';
        set(this.find('.part'), data ? data.part + line : empty);
        this.newDetail = null;
      }
      const last = this.tension.last;
      set(this.find('.tension'), last === null ? '\u2013' : last.toFixed(2).replace(/^-(0\.0*)$/, '$1'));
    }

    /* Show why the trial was aborted, or else the last log message about this finger. */
    showLast(said) {
      const trial = this.state.trial;
      const line = trial && trial.message ? { level: 'error', text: `trial aborted: ${trial.message}` }
        : said.filter((each) => each.finger === this.name).pop();
      const element = this.find('.last');
      element.hidden = !line;
      if (!line) return;
      element.className = `last ${line.level}`;
      set(element, line.text.replace(/ {2,}/g, ' \u00b7 '));
    }

    /* Set the text alternatives of the plots. */
    namePlots() {
      const range = this.tension.range;
      const trial = this.state && this.state.trial;
      const words = range === null ? 'no samples'
        : `now ${this.find('.tension').textContent} N, from ${range[0].toFixed(2)} to ${range[1].toFixed(2)} N`;
      name(this.find('.tension-plot'), `Tension of the last 10 seconds: ${words}; ${trial ? trial.phase : 'no trial'}`);
      name(this.find('.hold-plot'), `Tension in the hold with fitted line: ${this.find('.part').textContent}`);
      const peak = this.spectrum.peak;
      name(this.find('.spectrum-plot'), `Amplitude over frequency, ${this.find('.part').textContent}: `
        + (peak ? `largest ${peak.value.toFixed(1)} mN at ${peak.hz.toFixed(1)} Hz` : 'nothing yet'));
    }

    /* Show faults of the signal. If no samples arrive, show the diagnostics of the sensor, which have the remedy. */
    showFault(devices) {
      const sentences = [...(this.state ? this.state.faults : [])];
      if (this.heard === null || performance.now() - this.heard > SILENT_MS) {
        const path = this.name ? `${this.name}/tendon_sensor` : 'tendon_sensor';
        const sensor = devices.find((d) => d.name === path);
        const seconds = this.heard === null ? '' : ` for ${((performance.now() - this.heard) / 1000).toFixed(0)} s`;
        sentences.push(`Waiting for samples${seconds}: ` + (sensor && sensor.level !== 'ok'
          ? sensor.message : 'is the sensor plugged in? `tactile devices` lists the connected devices.'));
      }
      const element = this.find('.fault');
      element.hidden = !sentences.length;
      set(element, sentences.join(' '));
    }
  }

  /* ---- the whole page ---- */

  function takeState(next) {
    state = next;
    const names = new Set(state.fingers.map((f) => f.name));
    for (const [name, finger] of fingers) {
      if (!names.has(name)) { finger.root.remove(); fingers.delete(name); }  // it was known only to an earlier server
    }
    for (const finger of state.fingers) {
      if (!fingers.has(finger.name)) fingers.set(finger.name, new Finger(finger.name));
      fingers.get(finger.name).takeState(finger);
      fingers.get(finger.name).showLast(state.said);
    }
    $('waiting').hidden = state.fingers.length > 0;
    $('below').hidden = !(state.devices.length || state.said.length);
    $('simulated').hidden = !state.simulated;
    set($('where'), state.where ? `No finger on ${state.where}.` : 'No finger yet.');
    $('progress').hidden = !state.progress;
    set($('progress'), state.progress);
    showDevices();
    showSaid();
    const line = stopped && state.said.find((said) => said.id === stopped.id);
    if (line) Object.assign(stopped, { level: line.level, text: line.text });
    showStopped();
    showOutcome();
    showButtons();
  }

  /* Show the rigs that are stopped, also if another page has stopped them. */
  function showStopped() {
    const element = $('stopped');
    if (!element.hidden && !state.stopped.length) stopped = null;  // it was reset
    element.hidden = !state.stopped.length;
    enableReset();
    set(element, state.stopped.map((rig) => `Stopped${rig.finger ? ` (${rig.finger})` : ''}: ${rig.reason}. `
      + 'Guides do not move and tendons are not tightened until Reset.').join(' '));
  }

  function enableReset() {
    $('reset').disabled = $('stopped').hidden || document.body.classList.contains('off');
  }

  function showDevices() {
    $('devices').replaceChildren(...state.devices.map((device) => {
      const row = make('li', undefined, device.level);
      const text = make('div');
      text.append(make('b', device.name), ' ', make('span', device.message));
      if (device.level === 'ok') text.lastChild.textContent = device.message;
      for (const missing of device.missing) {
        if (!device.message.includes(missing.replace(/\.$/, ''))) text.append(make('em', missing));
      }
      const mark = make('i');
      mark.title = device.level;
      mark.setAttribute('role', 'img');
      name(mark, device.level);
      row.append(mark, text);
      return row;
    }));
  }

  function showSaid() {
    $('said').replaceChildren(...state.said.slice().reverse().map((line) => {
      const row = make('li', undefined, line.level);
      row.append(make('time', new Date(1000 * line.at).toLocaleTimeString([], { hour12: false })), line.text);
      return row;
    }));
  }

  function chosen() {
    return state && (state.fingers.find((f) => f.name === $('which').value) || state.fingers[0]);
  }

  function showButtons() {
    const movable = state.fingers.filter((f) => f.can.length);
    const which = $('which');
    const names = movable.map((f) => f.name);
    if ([...which.options].map((o) => o.value).join('\n') !== names.join('\n')) {
      which.replaceChildren(...names.map((name) => new Option(name || 'Finger', name)));
    }
    which.hidden = names.length < 2;
    const can = (chosen() || { can: [] }).can;
    $('release').hidden = !(token && state.can_release);
    $('reset').hidden = !(token && (state.can_release || state.stopped.length));  // always shown if the rig can be stopped, so that other buttons do not move
    for (const action of ['tare', 'home', 'trial']) {
      $(action).hidden = !(token && can.includes(action));
    }
  }

  function send(command) {
    if (!socket || socket.readyState !== WebSocket.OPEN) return false;
    socket.send(JSON.stringify(command));
    return true;
  }

  /* Stop is sent even if nothing is received, because the server may still receive it. */
  function stop() {
    $('ask').close();
    stopped = { id: String(Math.random()), at: performance.now(), level: '', text: '' };
    stopped.sent = send({ do: 'stop', id: stopped.id });
    showOutcome();
  }

  function showOutcome() {
    const element = $('outcome');
    const age = stopped ? performance.now() - stopped.at : Infinity;
    element.hidden = !stopped || (stopped.level === 'ok' && age > CONFIRMED_MS);
    // A confirmed Stop often ends the program that serves this page. In this case, only one message is shown.
    const isOff = document.body.classList.contains('off');
    const ended = isOff && !element.hidden && stopped.level === 'ok';
    $('cut').hidden = !isOff || ended;
    if (element.hidden) return;
    let { level, text } = stopped;
    if (ended) text += ' The page has lost its connection after this. To stop again, use the switch of the rig.';
    if (!stopped.sent) {
      [level, text] = ['error', 'Stop was not sent: this page is not connected. Use the switch of the rig.'];
    } else if (!level && age <= SILENT_MS) {
      text = 'Stop was sent, but is not confirmed yet.';
    } else if (!level) {
      [level, text] = ['error', 'Stop is not confirmed. Use the switch of the rig.'];
    }
    element.className = `outcome ${level}`;
    set(element, text[0].toUpperCase() + text.slice(1));
  }

  function ask(action) {
    const finger = chosen();
    if (finger) send({ do: action, finger: finger.name, token });
  }

  $('stop').addEventListener('click', stop);
  document.addEventListener('keydown', (event) => {
    if (event.key === 'Escape' && !event.repeat) stop();
  }, true);
  for (const action of ['release', 'reset']) $(action).addEventListener('click', () => send({ do: action, token }));
  $('tare').addEventListener('click', () => ask('tare'));
  $('home').addEventListener('click', () => ask('home'));
  $('which').addEventListener('change', () => state && showButtons());

  function offerObjects() {
    const labels = (state && state.objects[$('protocol').value]) || [];
    $('objects').replaceChildren(...labels.map((label) => new Option(label, label)));
  }
  $('protocol').addEventListener('change', offerObjects);
  $('trial').addEventListener('click', () => { offerObjects(); $('ask').show(); });  // not modal, so that Stop can be pressed
  $('cancel').addEventListener('click', () => $('ask').close());
  $('go').addEventListener('click', () => {
    $('ask').close();
    const finger = chosen();
    if (!finger) return;
    send({
      do: 'trial', finger: finger.name, protocol: $('protocol').value, contact: $('contact').value,
      object: $('object').value.trim(), token,
    });
  });

  function showLink(isOn) {
    const link = $('link');
    link.className = `link ${isOn ? 'on' : 'off'}`;
    set(link.querySelector('span'), isOn ? 'connected' : 'not connected');
    document.body.classList.toggle('off', !isOn);
    $('stop').classList.toggle('off', !isOn);
    for (const button of document.querySelectorAll('.moves button, #release, #go')) button.disabled = !isOn;
    enableReset();
    showOutcome();
  }

  function connect() {
    if (socket) socket.close();
    const own = socket = new WebSocket(`ws://${location.host}/live`, protocols);
    tried = performance.now();
    socket.addEventListener('message', (event) => {
      if (own !== socket) return;
      heard = performance.now();
      showLink(true);
      const frame = JSON.parse(event.data);
      if (frame.begin) for (const finger of fingers.values()) finger.epoch = null;
      if (frame.state) takeState(frame.state);
      for (const [name, live] of Object.entries(frame.live || {})) {
        const finger = fingers.get(name);
        if (finger) finger.takeLive(live);
      }
      dirty = true;
    });
    socket.addEventListener('close', () => {
      if (own !== socket) return;
      showLink(false);
      setTimeout(() => { if (own === socket) connect(); }, 1000);
    });
  }

  /* If the server hangs or the network fails, the WebSocket is not closed; only frames are missing. */
  function checkLink() {
    const now = performance.now();
    if (now - Math.max(heard, tried) > SILENT_MS) showLink(false);
    if (now - Math.max(heard, tried) > RETRY_MS) connect();
    showOutcome();
  }

  /* Keep the bar visible above the keyboard of a phone, and when the page is zoomed in. */
  function keepBarInSight() {
    const seen = visualViewport;
    const isCovered = seen.scale > 1.01 || seen.height < innerHeight - 1;
    Object.assign($('bar').style, isCovered ? {
      inset: `${seen.offsetTop + seen.height}px auto auto ${seen.offsetLeft}px`, width: `${seen.width}px`,
      maxHeight: `${seen.height}px`, transform: 'translateY(-100%)',
    } : { inset: '', width: '', maxHeight: '', transform: '' });
  }

  function draw() {
    if (dirty && !document.hidden) for (const finger of fingers.values()) finger.draw();
    dirty = false;
    requestAnimationFrame(draw);
  }

  setInterval(() => {
    checkLink();
    if (!document.body.classList.contains('off')) for (const finger of fingers.values()) {
      finger.showFault(state ? state.devices : []);
      finger.namePlots();
    }
  }, 250);
  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => {
    for (const finger of fingers.values()) { finger.tension.build(); finger.spectrum.build(); finger.hold.build(); }
  });
  addEventListener('hashchange', () => location.reload());  // the address has another token
  visualViewport.addEventListener('resize', keepBarInSight);
  visualViewport.addEventListener('scroll', keepBarInSight);
  keepBarInSight();
  new ResizeObserver(() => {
    document.body.style.paddingBottom = `${$('bar').offsetHeight + 16}px`;
  }).observe($('bar'));
  connect();
  requestAnimationFrame(draw);
})();
