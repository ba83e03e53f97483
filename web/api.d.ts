// Answers of the API, from its OpenAPI description: written by `python -m docs.make_api_types`.

declare namespace Api {
  interface Accepted {
    id: string;
    owner_token: string | null;
    existing: boolean;
    links: Links;
  }
  interface ExportBody {
    name: string;
    label: string;
    hint: string;
    media_type: string;
    filename: string;
    href: string;
  }
  interface ExportList {
    exports: ExportBody[];
  }
  interface Fault {
    code: string;
    values?: Record<string, unknown>;
    detail: string;
    message?: string | null;
    where?: string | null;
  }
  interface Feasibility {
    feasible: boolean | null;
    problems: Trouble[];
    repairs: Repair[];
  }
  interface Fold {
    id: string;
    name: string;
    title: string;
    status: "queued" | "running" | "verified" | "failed" | "cancelled";
    stage: "read" | "explode" | "play_back" | "certify" | "export" | null;
    created_at: string;
    expires_at: string | null;
    public: boolean;
    modules: number;
    module: string;
    module_words: ModuleWordsBody;
    shape: string | null;
    refold: string | null;
    smooths: string | null;
    preset: string;
    settings: string;
    seed: number;
    module_size: number | null;
    strategy: string;
    prefer: string;
    world: string;
    progress: Progress;
    summary: Record<string, unknown>;
    error: Fault | null;
    links: Links;
  }
  interface Folds {
    folds: Fold[];
  }
  interface FramesBody {
    status: string;
    total: number;
    from: number;
    to: number;
    stride: number;
    next: string | null;
    phases: string[];
    joint_names: string[];
    time_s: number[];
    phase: number[];
    joint_angles_rad: number[][];
    root_position: number[][];
    root_wxyz: number[][];
    max_error_rad: (number | null)[];
    positions: number[][][] | null;
    wxyzs: number[][][] | null;
  }
  interface KeyReplaced {
    owner_token: string;
    folds: number;
  }
  interface Knot {
    verdict: "unknot" | "knotted" | "undecided";
    determinant: number | null;
  }
  interface LikenessBody {
    iou: number;
    missing: number;
    added: number;
  }
  interface Links {
    self: string;
    page: string;
    drawing: string;
    events: string;
    frames: string;
    cancel: string;
    refolds: string;
    plan_json: string;
    plan_npz: string;
    model: string;
    exports: string;
  }
  interface ModuleWordsBody {
    singular: string;
    plural: string;
  }
  interface MovieBody {
    id: string;
    status: "queued" | "running" | "ready" | "failed";
    frames_done: number;
    frames_total: number;
    format: "mp4" | "gif";
    width: number;
    height: number;
    fps: number;
    seconds: number;
    problem: Fault | null;
    token?: string | null;
    links: MovieLinks;
  }
  interface MovieLinks {
    self: string;
    file: string;
    fold: string;
  }
  interface OwnedFolds {
    folds: Fold[];
    next: string | null;
    total: number;
  }
  interface OwnedMovie {
    title: string;
    created_at: string;
    movie: MovieBody;
  }
  interface OwnedMovies {
    movies: OwnedMovie[];
  }
  interface OwnedPreview {
    id: string;
    title: string;
    module: string;
    module_words: ModuleWordsBody;
    modules: number;
    created_at: string;
    expires_at: string;
    page: string;
    drawing: string;
  }
  interface OwnedPreviews {
    previews: OwnedPreview[];
  }
  interface PlacedMesh {
    vertices: number[][];
    faces: number[][];
  }
  interface Preview {
    id: string;
    key: string;
    kind: "path" | "chain" | "voxels" | "mesh" | "word" | "picture";
    name: string;
    module: string;
    module_words: ModuleWordsBody;
    follows_paths: boolean;
    modules: number;
    asked: number | null;
    below: number | null;
    above: number | null;
    iou: number | null;
    likeness?: LikenessBody | null;
    volume_kept?: number | null;
    tunnels?: TunnelCounts | null;
    keeps_parts?: boolean | null;
    unused_bodies?: number[];
    reach?: Reach[];
    pitch: number | null;
    method: string;
    possible_methods?: string[];
    has_path: boolean;
    candidates: number;
    final?: boolean;
    cells: number[][];
    feasibility: Feasibility | null;
    knot: Knot | null;
    notes: string[];
    repaired?: string;
    added?: number[][];
    as_voxels: boolean;
    start: number[] | null;
    not_started: string;
    expected_s: number;
    expected_as_published_s: number;
    expected_preferred_s: number;
    positions: number[][] | null;
    wxyzs: number[][] | null;
    line: number[][] | null;
    mesh: PlacedMesh | null;
    missing?: PlacedMesh | null;
    links: PreviewLinks;
  }
  interface PreviewLinks {
    page: string;
    folds: string;
  }
  interface Progress {
    status: "queued" | "running" | "verified" | "failed" | "cancelled";
    stage: "read" | "explode" | "play_back" | "certify" | "export" | null;
    fraction: number;
    steps: number;
    steps_per_second: number;
    simulated_s: number;
    message: string;
    plan: number;
    plans: number;
    modules: number;
    queue_position: number;
    running_before: number;
    paused: boolean;
    frames: number;
    busy: boolean;
    wait_s: number | null;
    remaining_s: number | null;
  }
  interface Reach {
    likeness: number;
    modules: number | null;
  }
  interface Repair {
    detail: string;
    add: number[][];
    drop: number[][];
    doubled: boolean;
    modules: number;
  }
  interface Shape {
    name: string;
    title: string;
    module: string;
    modules: number;
    tags: string[];
  }
  interface Shapes {
    shapes: Shape[];
  }
  interface TableChange {
    modules?: number | null;
    method?: "auto" | "blocks" | null;
    repair?: boolean | null;
  }
  interface TableOffer {
    kind: "repair" | "modules" | "blocks";
    modules: number;
    change: TableChange;
    added: number[][];
  }
  interface TableOffers {
    offers: TableOffer[];
  }
  interface TourBody {
    format: string;
    title: string;
    stops: TourStop[];
  }
  interface TourStop {
    caption: string;
    frame: number;
    modules?: number[] | null;
    from?: number | null;
    to?: number | null;
    camera?: string | null;
    follow?: boolean | null;
    colour?: string | null;
    path?: boolean | null;
  }
  interface Trouble {
    code: string;
    values: Record<string, unknown>;
    detail: string;
    cells: number[][];
  }
  interface TunnelCounts {
    mesh: number;
    cells: number;
  }
  interface ValuesBody {
    format: string;
    name: string;
    unit: string;
    low: number;
    high: number;
    rows: number;
    data: string;
  }
}
