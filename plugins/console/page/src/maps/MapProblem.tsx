import type { ComponentChildren } from "preact";
import { useEffect } from "preact/hooks";
import { Problem } from "../api/client";
import { link, lostMap } from "../router";
import { Empty } from "../ui/Empty";
import { ErrorText } from "../ui/ErrorText";

export interface MapProblemProps {
  map: string;
  error: unknown;
  again: () => void;
  /** What may bring the map. */
  children?: ComponentChildren;
}

/** A map that could not be opened. Where there is none of this name, the way leads back to those that are. */
export function MapProblem({ map, error, again, children }: MapProblemProps) {
  const isLost = error instanceof Problem && error.status === 404;
  useEffect(() => {
    lostMap.value = isLost ? map : "";
    return () => (lostMap.value = "");
  }, [map, isLost]);
  if (!isLost) return <ErrorText error={error} again={again} />;
  return (
    <Empty title={`There is no map ${map}`}>
      <p>It was deleted, its name is another one, or its first build has not ended.</p>
      {error.nearest ? (
        <p>
          Did you mean <a href={link(["maps", error.nearest])}>{error.nearest}</a>?
        </p>
      ) : null}
      {children}
      <a href={link(["maps"])}>All maps</a>
    </Empty>
  );
}
