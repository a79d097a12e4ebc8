// three.js has its types in another package, which users bring: this one is checked without them.
declare module 'three';
