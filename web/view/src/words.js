// SPDX-License-Identifier: Apache-2.0
// The texts of <l4d-player>, by language. Names in braces are values. What an error says of its cause is English.

const en = {
  scene: 'Scene. Drag to turn, arrow keys with Alt to turn, wheel or plus and minus to zoom, double click to look at a point.',
  controls: 'Player controls', time: 'Time', play: 'Play', pause: 'Pause', again: 'Play again', space: 'space', home: 'Show the whole scene',
  settings: 'Settings', fullscreen: 'Full screen', captions: 'Captions', off: 'Off', detail: 'Detail', auto: 'Automatic', full: 'Full', base: 'Base colours',
  motion: 'Motion', all: 'All', slow: 'Slow only', upTo: 'Up to level {level}', speed: 'Speed', camera: 'Camera', orbit: 'Orbit', fly: 'Fly',
  loop: 'Loop', numbers: 'Numbers', link: 'Copy link to this view', pip: 'Picture in picture', copied: 'Link copied', retry: 'Try again',
  zoomHint: 'Hold Ctrl to zoom, or click first', touchHint: 'Two fingers move the camera',
  ready: 'Ready, {what}', live: 'live', playing: 'Playing', paused: 'Paused', ended: 'The end', rate: 'Speed {rate}',
  complete: 'The recording has ended', slowLink: 'The connection is slow, trying again', stale: 'Nothing new has come for a while',
  restarted: 'The recording began again', of: '{part} of {whole}',
  failed: 'This cannot be played', NETWORK: 'The server does not answer', NOT_FOUND: 'The server does not have this file',
  HTTP: 'The server refuses this file', NO_RANGES: 'This server cannot send parts of this file', REQUEST: 'The page cannot ask for this file',
  CHANGED: 'The file has changed', NOT_L4D: 'This is no .l4d file', PLAYLIST: 'This playlist is damaged',
  VERSION_UNSUPPORTED: 'This file needs a newer player', CORRUPT: 'This file is damaged', TRUNCATED: 'This file is cut short',
  LIMIT_EXCEEDED: 'This file needs more memory than a page may use', OUT_OF_MEMORY: 'There is not enough memory',
  WEBGL2: 'This browser cannot draw the scene', gaps: 'Some of this recording is damaged or missing',
  hidden: 'Parts that cannot be shown: {count}', plain: 'Parts without detail of colours: {count}',
  frames: 'frames', splats: 'splats', draw: 'draw', sort: 'sort, draw', network: 'network', local: 'local', loaded: 'loaded',
  buffer: 'buffer', lost: 'lost', memory: 'memory', none: 'none', tier: 'tier {tier}', levels: 'all levels', level: 'level {level}'
};
/** @typedef {keyof typeof en} Word */

const de = {
  scene: 'Szene. Ziehen oder Pfeiltasten mit Alt drehen, Mausrad oder Plus und Minus zoomen, ein Doppelklick blickt auf einen Punkt.',
  controls: 'Steuerung', time: 'Zeit', play: 'Abspielen', pause: 'Pause', again: 'Noch einmal abspielen', space: 'Leertaste',
  home: 'Ganze Szene zeigen', settings: 'Einstellungen', fullscreen: 'Vollbild', captions: 'Untertitel', off: 'Aus', detail: 'Details', auto: 'Automatisch', full: 'Alle',
  base: 'Grundfarben', motion: 'Bewegung', all: 'Alle', slow: 'Nur langsame', upTo: 'Bis Ebene {level}', speed: 'Tempo', camera: 'Kamera',
  orbit: 'Kreisen', fly: 'Fliegen', loop: 'Wiederholen', numbers: 'Messwerte', link: 'Link zu dieser Ansicht kopieren', pip: 'Bild im Bild',
  copied: 'Link kopiert', retry: 'Erneut versuchen', zoomHint: 'Zum Zoomen Strg halten oder erst klicken',
  touchHint: 'Zwei Finger bewegen die Kamera',
  ready: 'Bereit, {what}', live: 'live', playing: 'Wiedergabe läuft', paused: 'Pausiert', ended: 'Ende', rate: 'Tempo {rate}',
  complete: 'Die Aufnahme ist zu Ende', slowLink: 'Die Verbindung ist langsam, neuer Versuch', stale: 'Seit einer Weile kommt nichts Neues',
  restarted: 'Die Aufnahme hat neu begonnen', of: '{part} von {whole}',
  failed: 'Das lässt sich nicht abspielen', NETWORK: 'Der Server antwortet nicht', NOT_FOUND: 'Der Server hat diese Datei nicht',
  HTTP: 'Der Server verweigert diese Datei', NO_RANGES: 'Dieser Server kann keine Teile der Datei senden',
  REQUEST: 'Die Seite kann diese Datei nicht anfordern', CHANGED: 'Die Datei hat sich geändert', NOT_L4D: 'Das ist keine .l4d-Datei',
  PLAYLIST: 'Diese Playlist ist beschädigt', VERSION_UNSUPPORTED: 'Diese Datei braucht einen neueren Player',
  CORRUPT: 'Diese Datei ist beschädigt', TRUNCATED: 'Diese Datei ist unvollständig',
  LIMIT_EXCEEDED: 'Diese Datei braucht mehr Speicher, als eine Seite nutzen darf', OUT_OF_MEMORY: 'Der Speicher reicht nicht aus',
  WEBGL2: 'Dieser Browser kann die Szene nicht zeichnen', gaps: 'Teile dieser Aufnahme sind beschädigt oder fehlen',
  hidden: 'Nicht darstellbare Teile: {count}', plain: 'Teile ohne Farbdetails: {count}',
  frames: 'Bilder', splats: 'Splats', draw: 'zeichnen', sort: 'sortieren, zeichnen', network: 'Netz', local: 'lokal', loaded: 'geladen',
  buffer: 'Puffer', lost: 'verloren', memory: 'Speicher', none: 'keine', tier: 'Stufe {tier}', levels: 'alle Ebenen', level: 'Ebene {level}'
};

const es = {
  scene: 'Escena. Arrastre o use las flechas con Alt para girar, la rueda o más y menos para acercar, doble clic para mirar un punto.',
  controls: 'Controles del reproductor', time: 'Tiempo', play: 'Reproducir', pause: 'Pausar', again: 'Reproducir de nuevo', space: 'espacio',
  home: 'Mostrar toda la escena', settings: 'Ajustes', fullscreen: 'Pantalla completa', captions: 'Subtítulos', off: 'No', detail: 'Detalle', auto: 'Automático',
  full: 'Completo', base: 'Colores base', motion: 'Movimiento', all: 'Todo', slow: 'Solo lento', upTo: 'Hasta el nivel {level}',
  speed: 'Velocidad', camera: 'Cámara', orbit: 'Orbitar', fly: 'Volar', loop: 'Repetir', numbers: 'Datos',
  link: 'Copiar enlace a esta vista', pip: 'Imagen en imagen', copied: 'Enlace copiado', retry: 'Reintentar', zoomHint: 'Mantenga Ctrl para acercar, o haga clic primero',
  touchHint: 'Mueva la cámara con dos dedos',
  ready: 'Listo, {what}', live: 'en directo', playing: 'Reproduciendo', paused: 'En pausa', ended: 'Fin', rate: 'Velocidad {rate}',
  complete: 'La grabación ha terminado', slowLink: 'La conexión es lenta, nuevo intento', stale: 'Hace un rato que no llega nada nuevo',
  restarted: 'La grabación ha empezado de nuevo', of: '{part} de {whole}',
  failed: 'No se puede reproducir', NETWORK: 'El servidor no responde', NOT_FOUND: 'El servidor no tiene este archivo',
  HTTP: 'El servidor rechaza este archivo', NO_RANGES: 'Este servidor no puede enviar partes del archivo',
  REQUEST: 'La página no puede pedir este archivo', CHANGED: 'El archivo ha cambiado', NOT_L4D: 'No es un archivo .l4d',
  PLAYLIST: 'Esta lista está dañada', VERSION_UNSUPPORTED: 'Este archivo necesita un reproductor más nuevo',
  CORRUPT: 'Este archivo está dañado', TRUNCATED: 'Este archivo está incompleto',
  LIMIT_EXCEEDED: 'Este archivo necesita más memoria de la que permite una página', OUT_OF_MEMORY: 'No hay memoria suficiente',
  WEBGL2: 'Este navegador no puede dibujar la escena', gaps: 'Falta o está dañada parte de esta grabación',
  hidden: 'Partes que no se pueden mostrar: {count}', plain: 'Partes sin detalle de color: {count}',
  frames: 'imágenes', splats: 'splats', draw: 'dibujo', sort: 'orden, dibujo', network: 'red', local: 'local', loaded: 'cargado',
  buffer: 'búfer', lost: 'perdido', memory: 'memoria', none: 'ninguno', tier: 'capa {tier}', levels: 'todos los niveles', level: 'nivel {level}'
};

const fr = {
  scene: 'Scène. Glissez ou utilisez les flèches avec Alt pour tourner, la molette ou plus et moins pour zoomer, double-cliquez pour viser un point.',
  controls: 'Commandes du lecteur', time: 'Temps', play: 'Lire', pause: 'Pause', again: 'Relire', space: 'espace',
  home: 'Montrer toute la scène', settings: 'Réglages', fullscreen: 'Plein écran', captions: 'Sous-titres', off: 'Non', detail: 'Détail', auto: 'Automatique', full: 'Complet',
  base: 'Couleurs de base', motion: 'Mouvement', all: 'Tout', slow: 'Lent seulement', upTo: 'Jusqu’au niveau {level}', speed: 'Vitesse',
  camera: 'Caméra', orbit: 'Orbite', fly: 'Vol', loop: 'Boucle', numbers: 'Mesures', link: 'Copier le lien vers cette vue', pip: 'Image dans l’image',
  copied: 'Lien copié', retry: 'Réessayer', zoomHint: 'Maintenez Ctrl pour zoomer, ou cliquez d’abord',
  touchHint: 'Deux doigts déplacent la caméra',
  ready: 'Prêt, {what}', live: 'en direct', playing: 'Lecture', paused: 'En pause', ended: 'Fin', rate: 'Vitesse {rate}',
  complete: 'L’enregistrement est terminé', slowLink: 'La connexion est lente, nouvel essai', stale: 'Rien de nouveau depuis un moment',
  restarted: 'L’enregistrement a recommencé', of: '{part} sur {whole}',
  failed: 'Lecture impossible', NETWORK: 'Le serveur ne répond pas', NOT_FOUND: 'Le serveur n’a pas ce fichier',
  HTTP: 'Le serveur refuse ce fichier', NO_RANGES: 'Ce serveur ne peut pas envoyer des parties du fichier',
  REQUEST: 'La page ne peut pas demander ce fichier', CHANGED: 'Le fichier a changé', NOT_L4D: 'Ce n’est pas un fichier .l4d',
  PLAYLIST: 'Cette liste est endommagée', VERSION_UNSUPPORTED: 'Ce fichier demande un lecteur plus récent',
  CORRUPT: 'Ce fichier est endommagé', TRUNCATED: 'Ce fichier est incomplet',
  LIMIT_EXCEEDED: 'Ce fichier demande plus de mémoire qu’une page ne peut en utiliser', OUT_OF_MEMORY: 'La mémoire ne suffit pas',
  WEBGL2: 'Ce navigateur ne peut pas dessiner la scène', gaps: 'Une partie de cet enregistrement manque ou est endommagée',
  hidden: 'Parties impossibles à montrer : {count}', plain: 'Parties sans détail des couleurs : {count}',
  frames: 'images', splats: 'splats', draw: 'dessin', sort: 'tri, dessin', network: 'réseau', local: 'local', loaded: 'chargé',
  buffer: 'tampon', lost: 'perdu', memory: 'mémoire', none: 'aucun', tier: 'palier {tier}', levels: 'tous les niveaux', level: 'niveau {level}'
};

const ja = {
  scene: 'シーン。ドラッグ、または Alt と矢印キーで回転、ホイール、またはプラスとマイナスでズーム、ダブルクリックでその点を見ます。',
  controls: 'プレーヤーの操作', time: '時間', play: '再生', pause: '一時停止', again: 'もう一度再生', space: 'スペース', home: 'シーン全体を表示',
  settings: '設定', fullscreen: '全画面', captions: '字幕', off: 'オフ', detail: '詳細度', auto: '自動', full: '最大', base: '基本色のみ', motion: '動き', all: 'すべて',
  slow: 'ゆっくりのみ', upTo: 'レベル {level} まで', speed: '速度', camera: 'カメラ', orbit: '周回', fly: '飛行', loop: 'ループ', numbers: '数値を表示',
  link: 'この視点へのリンクをコピー', pip: 'ピクチャー イン ピクチャー', copied: 'リンクをコピーしました', retry: '再試行', zoomHint: 'ズームするには Ctrl を押すか、先にクリックします',
  touchHint: '2 本の指でカメラを動かせます',
  ready: '準備完了、{what}', live: 'ライブ', playing: '再生中', paused: '一時停止中', ended: '終わり', rate: '速度 {rate}',
  complete: '録画は終了しました', slowLink: '接続が遅いため再試行しています', stale: 'しばらく新しいデータが届いていません',
  restarted: '録画が最初からやり直されました', of: '{whole}中{part}',
  failed: '再生できません', NETWORK: 'サーバーが応答しません', NOT_FOUND: 'サーバーにこのファイルがありません',
  HTTP: 'サーバーがこのファイルを拒否しました', NO_RANGES: 'このサーバーはファイルの一部を送信できません',
  REQUEST: 'ページがこのファイルを要求できません', CHANGED: 'ファイルが変更されました', NOT_L4D: '.l4d ファイルではありません',
  PLAYLIST: 'プレイリストが壊れています', VERSION_UNSUPPORTED: 'このファイルにはより新しいプレーヤーが必要です',
  CORRUPT: 'ファイルが壊れています', TRUNCATED: 'ファイルが途中で切れています',
  LIMIT_EXCEEDED: 'このファイルには、ページが使えるよりも多くのメモリが必要です', OUT_OF_MEMORY: 'メモリが足りません',
  WEBGL2: 'このブラウザーはシーンを描画できません', gaps: '録画の一部が壊れているか、ありません',
  hidden: '表示できない部分: {count}', plain: '色の詳細がない部分: {count}',
  frames: 'フレーム', splats: 'スプラット', draw: '描画', sort: 'ソート, 描画', network: '通信', local: 'ローカル', loaded: '読み込み',
  buffer: 'バッファー', lost: '損失', memory: 'メモリ', none: 'なし', tier: '段階 {tier}', levels: '全レベル', level: 'レベル {level}'
};

const zh = {
  scene: '场景。拖动或按 Alt 加方向键旋转，用滚轮或加减号缩放，双击注视该点。',
  controls: '播放器控件', time: '时间', play: '播放', pause: '暂停', again: '重新播放', space: '空格', home: '显示整个场景', settings: '设置',
  fullscreen: '全屏', captions: '字幕', off: '关闭', detail: '细节', auto: '自动', full: '完整', base: '仅基础颜色', motion: '运动', all: '全部', slow: '仅慢速', upTo: '至第 {level} 级',
  speed: '速度', camera: '相机', orbit: '环绕', fly: '飞行', loop: '循环', numbers: '显示数据', link: '复制此视角的链接', pip: '画中画', copied: '链接已复制',
  retry: '重试', zoomHint: '按住 Ctrl 缩放，或先点击', touchHint: '用双指移动相机', ready: '就绪，{what}', live: '直播', playing: '正在播放', paused: '已暂停', ended: '结束',
  rate: '速度 {rate}', complete: '录制已结束', slowLink: '连接较慢，正在重试', stale: '已有一段时间没有新内容', restarted: '录制已重新开始',
  of: '{part}，共 {whole}',
  failed: '无法播放', NETWORK: '服务器没有响应', NOT_FOUND: '服务器上没有此文件', HTTP: '服务器拒绝提供此文件',
  NO_RANGES: '此服务器无法发送文件的一部分', REQUEST: '页面无法请求此文件', CHANGED: '文件已更改', NOT_L4D: '这不是 .l4d 文件',
  PLAYLIST: '此播放列表已损坏', VERSION_UNSUPPORTED: '此文件需要更新的播放器', CORRUPT: '此文件已损坏', TRUNCATED: '此文件不完整',
  LIMIT_EXCEEDED: '此文件所需的内存超出页面的限制', OUT_OF_MEMORY: '内存不足', WEBGL2: '此浏览器无法绘制场景',
  gaps: '此录制有部分损坏或缺失', hidden: '无法显示的部分：{count}', plain: '缺少颜色细节的部分：{count}',
  frames: '帧', splats: '高斯点', draw: '绘制', sort: '排序, 绘制', network: '网络', local: '本地', loaded: '已加载', buffer: '缓冲', lost: '丢失',
  memory: '内存', none: '无', tier: '第 {tier} 层', levels: '所有级别', level: '第 {level} 级'
};

/** By language, in lower case. @type {Record<string, Partial<Record<Word, string>>>} */
export const words = {en, de, es, fr, ja, zh};
/** Says 'change' when there are other words. */
export const changes = new EventTarget();

/** Adds words to languages, or replaces them. @param {Record<string, Partial<Record<Word, string>>>} more */
export const addWords = more => {
  for (const [language, texts] of Object.entries(more)) {
    Intl.getCanonicalLocales(language);  // throws here, and not in each player
    const name = language.toLowerCase();
    words[name] = {...words[name], ...texts};
  }
  changes.dispatchEvent(new Event('change'));
};

/** The language that a tag means, if it has words: "de" for "de-AT". @param {string} tag */
const known = tag => {
  const parts = tag.toLowerCase().split('-');
  for (; parts.length > 0; parts.pop()) if (words[parts.join('-')]) return parts.join('-');
};

/** What the element or the closest one around it states, or else what the reader wants; English where that has no words. @param {Element} element */
export const languageOf = element => {
  for (let at = element; at; at = /** @type {ShadowRoot} */ (at.getRootNode()).host) {
    const lang = /** @type {HTMLElement | null} */ (at.closest('[lang]:not([lang=""])'))?.lang;
    if (lang) return known(lang) ?? 'en';
  }
  return navigator.languages.map(known).find(Boolean) ?? 'en';
};

/** Observes what languageOf() reads. @param {Element} element @param {MutationObserver} observer */
export const watchLanguage = (element, observer) => {
  for (let at = element; at; at = /** @type {ShadowRoot} */ (at.getRootNode()).host) {
    observer.observe(at.getRootNode(), {subtree: true, attributeFilter: ['lang']});
  }
};

/** The words and numbers of a language. */
export class Texts {
  /** @param {string} language */
  constructor(language) {
    this.language = language;
    /** By options: they are slow to make, and the time changes with each frame. @type {Map<string, Intl.NumberFormat>} */
    this.formats = new Map();
  }

  /** @param {Word} word @param {Record<string, string | number | undefined>} [values] */
  say(word, values = {}) {
    return (words[this.language][word] ?? en[word]).replace(/\{(\w+)\}/g, (_, name) => String(values[name]));
  }

  /** @param {number} value @param {Intl.NumberFormatOptions} [options] */
  number(value, options = {}) {
    const key = JSON.stringify(options);
    const format = this.formats.get(key) ?? new Intl.NumberFormat(this.language, options);
    this.formats.set(key, format);
    return format.format(value);
  }

  /** Fills what an element and those in it say: `data-text` and `data-label` are words, other data their values, `data-key` does the same.
   *  @param {ParentNode} root */
  fill(root) {
    for (const element of /** @type {NodeListOf<HTMLElement>} */ (root.querySelectorAll('[data-text], [data-label]'))) {
      const {text, label, key} = element.dataset;
      const {dataset} = element;
      if (text) element.textContent = this.say(/** @type {Word} */ (text), dataset);
      if (!label) continue;
      const name = this.say(/** @type {Word} */ (label));
      element.setAttribute('aria-label', name);
      if (element.closest('.row')) element.title = key ? `${name} (${key === 'space' ? this.say(key) : key})` : name;
    }
  }
}
