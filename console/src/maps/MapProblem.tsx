import { useEffect } from "preact/hooks";
import { Problem } from "../api/client";
import { link, lostMap } from "../router";
import { Empty } from "../ui/Empty";
import { ErrorText } from "../ui/ErrorText";

/** A map that could not be opened. Where there is none of this name, the way leads back to those that are. */
export function MapProblem({ map, error, again }: { map: string; error: unknown; again: () => void }) {
  const isLost = error instanceof Problem && error.status === 404;
  useEffect(() => {
    lostMap.value = isLost ? map : "";
    return () => (lostMap.value = "");
  }, [map, isLost]);
  if (!isLost) return <ErrorText error={error} again={again} />;
  return (
    <Empty title={`There is no map ${map}`}>
      <p>It was deleted, or its name is another one.</p>
      <a href={link(["maps"])}>All maps</a>
    </Empty>
  );
}
