#!/usr/bin/env bash
# Label a large dataset on a Slurm cluster: every job of the array makes one shard of one table.
#
#     sbatch --array=1-100 examples/slurm_label.sh PATH OUT [options of animal3dbox label]
#
# A job that was killed, or ran out of time, is simply submitted again: rows that are there are kept.
# The first job that opens a large COCO file writes an index beside the table, by which the others
# open it; submit one job before the others, or the first ones make it each.
#SBATCH --job-name=animal3dbox
#SBATCH --cpus-per-task=4
#SBATCH --mem=8G
#SBATCH --time=04:00:00
set -euo pipefail
dataset=${1:?PATH: the dataset}
out=${2:?OUT: the folder of the table, on a file system that all jobs see}
shift 2
export OMP_NUM_THREADS=1  # one thread a worker; the workers are what uses the processors
exec "${ANIMAL3DBOX:-animal3dbox}" label "$dataset" --table "$out" --resume \
    --shard "$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT" --workers "$SLURM_CPUS_PER_TASK" "$@"
