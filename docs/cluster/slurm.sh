#!/bin/bash
# A task of a study as a job of a Slurm array. The folder of the results lies where all nodes see it.
#
#   array=$(sbatch --parsable --array=1-8 slurm.sh study study/study.toml --out done)
#   sbatch --dependency=afterok:$array --wrap 'carpus merge done'
#
# Behind slurm.sh stands the command without carpus: study or diagnose, with its options. CARPUS names the program where
# it is not on the path.
#SBATCH --job-name=carpus
#SBATCH --cpus-per-task=1
#SBATCH --output=carpus-%A_%a.log
#SBATCH --open-mode=append
#SBATCH --requeue
# A job whose node failed is put into the queue again and goes on where it was.

task=$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT
exec "${CARPUS:-carpus}" "$@" --task "$task" --threads "${SLURM_CPUS_PER_TASK:-1}"
